// SPDX-License-Identifier: Apache-2.0
#include "tests/reference/phantom/cross_section.h"

#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <string>

namespace trocar::sample {
namespace {

constexpr double kRootTolerance_mm = 1e-10;
// HU range of all soft tissue near bone, including its texture.
constexpr double kSoftTissueTop_hu = 110, kSoftTissueBottom_hu = -120;

/// The zero of f in [a, b], given f(a) < 0 <= f(b), to kRootTolerance_mm (ITP method).
template <typename F>
double find_root(const F& f, double a, double b, double fa, double fb) {
  const double k1 = 0.1 / (b - a);
  const int steps = static_cast<int>(std::ceil(std::log2((b - a) / (2 * kRootTolerance_mm)))) + 1;
  double scale = std::ldexp(kRootTolerance_mm, steps);
  while (b - a > 2 * kRootTolerance_mm) {
    const double middle = 0.5 * (a + b), width = b - a;
    const double r = scale - 0.5 * width;
    scale *= 0.5;
    const double secant = (fb * a - fa * b) / (fb - fa);
    const double sigma = middle >= secant ? 1.0 : -1.0;
    const double shift = k1 * width * width;
    const double truncated = shift <= std::abs(middle - secant) ? secant + sigma * shift : middle;
    const double x = std::abs(truncated - middle) <= r ? truncated : middle - sigma * r;
    const double fx = f(x);
    if (fx >= 0)
      b = x, fb = fx;
    else
      a = x, fa = fx;
    if (fx == 0) return x;
  }
  return 0.5 * (a + b);
}

/// The zero of the field between a point outside the material (value < 0) and one inside.
Vec2 crossing(const PlaneField& field, Vec2 outside, Vec2 inside, double f_out, double f_in) {
  const Vec2 step = inside - outside;
  const double length = norm(step);
  const auto at = [&](double t) { return outside + (t / length) * step; };
  return at(find_root([&](double t) { return field.value(at(t)); }, 0, length, f_out, f_in));
}

class Tracer {
 public:
  Tracer(const PlaneField& field, Vec2 lower, Vec2 upper, const SectionOptions& options)
      : field_(field), lower_(lower), options_(options) {
    const double extent = std::max(upper.x - lower.x, upper.y - lower.y);
    while (options.cell_mm * cells_ < extent)
      cells_ *= 2;
    values_.assign(static_cast<std::size_t>(cells_ + 1) * (cells_ + 1),
                   std::numeric_limits<double>::quiet_NaN());
  }

  Result<void> trace(CrossSection& section) {
    visit(0, 0, cells_);
    if (left_the_field_) return refused("the outline leaves the rectangle that is searched");
    while (!next_.empty()) {
      std::vector<Vec2> coarse;
      for (auto at = next_.begin(); at != next_.end(); at = next_.find(coarse_follow_)) {
        coarse.push_back(points_.at(at->first));
        coarse_follow_ = at->second;
        next_.erase(at);
      }
      if (!refine(coarse, section))
        return bug("an outline bends too sharply for cells of " + std::to_string(options_.cell_mm) +
                   " mm");
    }
    return {};
  }

 private:
  using Edge = std::int64_t;  // 2 * lattice point + (0: towards x, 1: towards y)

  std::size_t corner(int i, int j) const { return static_cast<std::size_t>(j) * (cells_ + 1) + i; }
  Vec2 position(double i, double j) const {
    return lower_ + Vec2{i * options_.cell_mm, j * options_.cell_mm};
  }
  double value(int i, int j) {
    double& v = values_[corner(i, j)];
    if (std::isnan(v)) v = field_.value(position(i, j));
    return v;
  }

  void visit(int i, int j, int size) {
    const double half = 0.5 * size;
    if (field_.clear_mm(position(i + half, j + half)) > half * options_.cell_mm * 1.4143) return;
    if (size == 1) return cell(i, j);
    const int s = size / 2;
    for (const int dj : {0, s})
      for (const int di : {0, s})
        visit(i + di, j + dj, s);
  }

  /// Walks counter-clockwise around one square. Joins each crossing at which the material ends to
  /// one at which it begins, so that the material stays on the left.
  void cell(int i, int j) {
    const std::array<std::array<int, 2>, 4> at{{{i, j}, {i + 1, j}, {i + 1, j + 1}, {i, j + 1}}};
    std::array<double, 4> f{};
    for (int c = 0; c < 4; ++c)
      f[c] = value(at[c][0], at[c][1]);
    std::array<int, 4> change{};  // +1: material ends on this edge, -1: begins, 0: neither
    int crossings = 0;
    for (int c = 0; c < 4; ++c) {
      change[c] = (f[c] >= 0) - (f[(c + 1) % 4] >= 0);
      crossings += change[c] != 0;
    }
    if (crossings == 0) return;
    // If there are four crossings, the centre decides whether the two material corners are joined.
    const bool joined = crossings == 4 && field_.value(position(i + 0.5, j + 0.5)) >= 0;
    for (int c = 0; c < 4; ++c) {
      if (change[c] != 1) continue;
      int end = c;
      do
        end = (end + (joined ? 1 : 3)) % 4;
      while (change[end] != -1);
      next_[edge(at, f, c)] = edge(at, f, end);
    }
  }

  Edge edge(const std::array<std::array<int, 2>, 4>& at, const std::array<double, 4>& f, int c) {
    const int d = (c + 1) % 4;
    const auto low = std::min(
        at[c], at[d], [](const auto& a, const auto& b) { return a[0] + a[1] < b[0] + b[1]; });
    const bool upright = c % 2 == 1;
    const Edge key = 2 * static_cast<Edge>(corner(low[0], low[1])) + upright;
    if (!points_.contains(key)) {
      const int in = f[c] >= 0 ? c : d, out = in == c ? d : c;
      points_[key] = crossing(field_, position(at[out][0], at[out][1]),
                              position(at[in][0], at[in][1]), f[out], f[in]);
      const int across = upright ? low[0] : low[1];
      if (across == 0 || across == cells_) left_the_field_ = true;
    }
    return key;
  }

  /// The point of the curve on the perpendicular bisector of the chord ab; std::nullopt if none is
  /// near.
  std::optional<Vec2> over_middle(Vec2 a, Vec2 b) const {
    const Vec2 chord = b - a, middle = 0.5 * (a + b);
    const Vec2 right{chord.y, -chord.x};  // has the chord's length and points out of the material
    const double f = field_.value(middle);
    if (f == 0) return middle;
    for (const double reach : {0.05, 0.25, 1.0, 2.0}) {
      const Vec2 other = middle + (f > 0 ? reach : -reach) * right;
      const double g = field_.value(other);
      if ((f > 0) == (g >= 0)) continue;
      return f > 0 ? crossing(field_, other, middle, g, f) : crossing(field_, middle, other, f, g);
    }
    return std::nullopt;
  }

  bool split(Vec2 a, Vec2 b, int depth, std::vector<Vec2>& ring, CrossSection& section) const {
    const double length = norm(b - a);
    if (length < 1e-6) return true;
    const std::optional<Vec2> peak = over_middle(a, b);
    if (!peak) return false;
    const double rise = cross(*peak - a, b - a) / length;  // positive outside the material
    if (std::abs(rise) <= options_.tolerance_mm || depth == 0) {
      section.area_mm2 += 2.0 / 3.0 * length * rise;
      section.area_error_mm2 += 0.25 * length * options_.tolerance_mm;
      return true;
    }
    if (!split(a, *peak, depth - 1, ring, section)) return false;
    ring.push_back(*peak);
    return split(*peak, b, depth - 1, ring, section);
  }

  bool refine(const std::vector<Vec2>& coarse, CrossSection& section) const {
    std::vector<Vec2> ring;
    for (std::size_t i = 0; i < coarse.size(); ++i) {
      const Vec2 a = coarse[i], b = coarse[(i + 1) % coarse.size()];
      if (ring.empty() || norm(a - ring.back()) > 1e-6) ring.push_back(a);
      if (!split(a, b, 16, ring, section)) return false;
    }
    while (ring.size() > 1 && norm(ring.back() - ring.front()) <= 1e-6)
      ring.pop_back();
    if (ring.size() < 3) return true;
    std::rotate(ring.begin(),
                std::min_element(ring.begin(), ring.end(),
                                 [](Vec2 a, Vec2 b) { return a.y != b.y ? a.y < b.y : a.x < b.x; }),
                ring.end());
    for (std::size_t i = 0; i < ring.size(); ++i)
      section.area_mm2 += 0.5 * cross(ring[i] - ring[0], ring[(i + 1) % ring.size()] - ring[0]);
    section.rings.push_back(std::move(ring));
    return true;
  }

  const PlaneField& field_;
  Vec2 lower_;
  SectionOptions options_;
  int cells_ = 1;
  std::vector<double> values_;
  std::map<Edge, Edge> next_;
  std::map<Edge, Vec2> points_;
  Edge coarse_follow_ = -1;
  bool left_the_field_ = false;
};

/// A square that holds all bone.
constexpr double kHalfExtent_mm = 62;

Result<CrossSection> trace_bone(const PhantomOptions& phantom, double z_mm, const PlaneField& field,
                                const SectionOptions& options) {
  const Vec3 middle = to_scan(phantom, {0, 27, z_mm});
  const Vec2 half{kHalfExtent_mm, kHalfExtent_mm};
  return trace_section(field, Vec2{middle.x, middle.y} - half, Vec2{middle.x, middle.y} + half,
                       z_mm, options);
}

}  // namespace

Vec3 to_scan(const PhantomOptions& phantom, Vec3 p) {
  const double c = std::cos(phantom.rotation_rad), s = std::sin(phantom.rotation_rad);
  return {c * p.x - s * p.y + phantom.shift_mm.x, s * p.x + c * p.y + phantom.shift_mm.y, p.z};
}

double bone_distance_mm(Vec3 p) {
  return sample_bone(p).distance_mm;
}

double bone_distance_mm(const PhantomOptions& phantom, Vec3 p_scan) {
  return sample_bone(phantom, p_scan).distance_mm;
}

double field_hu(const PhantomOptions& phantom, Vec3 p_scan) {
  return mixed_hu(phantom, blurred_fractions(phantom, sample_bone(phantom, p_scan)),
                  soft_tissue_hu(phantom, p_scan), cancellous_hu(phantom, p_scan));
}

Result<CrossSection> trace_section(const PlaneField& field, Vec2 lower, Vec2 upper, double z_mm,
                                   const SectionOptions& options) {
  if (!(options.cell_mm > 0) || !(options.tolerance_mm > 0))
    return usage("a cross-section's cell and tolerance must be positive");
  if (!(upper.x > lower.x) || !(upper.y > lower.y) ||
      !(std::max(upper.x - lower.x, upper.y - lower.y) <= 1024 * options.cell_mm))
    return usage("a cross-section's rectangle must be at most 1024 cells wide");
  CrossSection section;
  section.z_mm = z_mm;
  section.tolerance_mm = options.tolerance_mm;
  // Smaller cells separate two branches of the outline that are closer than a cell.
  constexpr int kHalvings = 4;
  for (int halving = 0;; ++halving) {
    SectionOptions finer = options;
    finer.cell_mm = std::ldexp(options.cell_mm, -halving);
    section.rings.clear();
    section.area_mm2 = section.area_error_mm2 = 0;
    const Result<void> traced = Tracer(field, lower, upper, finer).trace(section);
    if (traced) break;
    if (traced.error().code != ExitCode::kBug || halving == kHalvings) return traced.error();
  }
  std::sort(section.rings.begin(), section.rings.end(), [](const auto& a, const auto& b) {
    return a[0].y != b[0].y ? a[0].y < b[0].y : a[0].x < b[0].x;
  });
  return section;
}

Result<CrossSection> surface_section(const PhantomOptions& phantom, double z_mm,
                                     const SectionOptions& options) {
  const auto distance = [&](Vec2 p) { return bone_distance_mm(phantom, Vec3{p.x, p.y, z_mm}); };
  const PlaneField field{[&](Vec2 p) { return -distance(p); },
                         [&](Vec2 p) { return std::abs(distance(p)); }};
  return trace_bone(phantom, z_mm, field, options);
}

Result<CrossSection> iso_section(const PhantomOptions& phantom, const ScanGeometry& scan,
                                 double z_mm, double iso_hu, const SectionOptions& options) {
  const double core = phantom.tissue.cancellous - phantom.tissue.cancellous_texture;
  if (!(iso_hu > kSoftTissueTop_hu) || !(iso_hu < core))
    return usage("iso-value " + std::to_string(iso_hu) + " HU is not between soft tissue (" +
                 std::to_string(kSoftTissueTop_hu) + ") and cancellous bone (" +
                 std::to_string(core) + ")");
  // If the bone's surface is at least this far from the pixel's aperture, the reading is certainly
  // on one side of the iso-value: at most the fraction `tail` of it comes from the other side of
  // the surface, because Phi(-t) <= exp(-t^2 / 2) / 2.
  const double tail =
      std::min((iso_hu - kSoftTissueTop_hu) / (phantom.tissue.cortical - kSoftTissueTop_hu),
               (core - iso_hu) / (core - kSoftTissueBottom_hu));
  const double reach = aperture_radius_mm(scan) +
                       phantom.edge_sigma_mm * std::sqrt(std::max(0.0, -2 * std::log(2 * tail)));
  const PlaneField field{[&](Vec2 p) {
                           return scanner_hu(phantom, scan, {p.x, p.y, z_mm}) - iso_hu;
                         },
                         [&](Vec2 p) {
                           return std::abs(bone_distance_mm(phantom, Vec3{p.x, p.y, z_mm})) - reach;
                         }};
  return trace_bone(phantom, z_mm, field, options);
}

SectionDistance::SectionDistance(const CrossSection& section) {
  Vec2 upper;
  for (const auto& ring : section.rings)
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const Vec2 p = ring[i];
      if (segments_.empty()) origin_ = upper = p;
      origin_ = {std::min(origin_.x, p.x), std::min(origin_.y, p.y)};
      upper = {std::max(upper.x, p.x), std::max(upper.y, p.y)};
      segments_.push_back({p, ring[(i + 1) % ring.size()]});
    }
  if (segments_.empty()) return;
  columns_ = static_cast<int>((upper.x - origin_.x) / cell_mm_) + 1;
  rows_ = static_cast<int>((upper.y - origin_.y) / cell_mm_) + 1;
  buckets_.resize(static_cast<std::size_t>(columns_) * rows_);
  strips_.resize(static_cast<std::size_t>(rows_));
  for (std::size_t s = 0; s < segments_.size(); ++s) {
    const auto [a, b] = segments_[s];
    const int i0 = static_cast<int>((std::min(a.x, b.x) - origin_.x) / cell_mm_);
    const int i1 = static_cast<int>((std::max(a.x, b.x) - origin_.x) / cell_mm_);
    const int j0 = static_cast<int>((std::min(a.y, b.y) - origin_.y) / cell_mm_);
    const int j1 = static_cast<int>((std::max(a.y, b.y) - origin_.y) / cell_mm_);
    for (int j = j0; j <= j1; ++j) {
      strips_[j].push_back(static_cast<int>(s));
      for (int i = i0; i <= i1; ++i)
        buckets_[static_cast<std::size_t>(j) * columns_ + i].push_back(static_cast<int>(s));
    }
  }
}

bool SectionDistance::inside(Vec2 p) const {
  const double row = std::floor((p.y - origin_.y) / cell_mm_);
  if (!(row >= 0) || !(row < rows_)) return false;
  bool odd = false;
  for (const int s : strips_[static_cast<std::size_t>(row)]) {
    const auto [a, b] = segments_[s];
    if ((a.y <= p.y) == (b.y <= p.y)) continue;
    const double orientation = cross(b - a, p - a);
    if ((orientation > 0) == (b.y > a.y)) odd = !odd;  // the segment passes to the right of p
  }
  return odd;
}

double SectionDistance::operator()(Vec2 p) const {
  if (segments_.empty()) return std::numeric_limits<double>::infinity();
  const auto clamp_cell = [&](double x, int n) {
    return static_cast<int>(std::clamp(std::floor(x / cell_mm_), 0.0, n - 1.0));
  };
  const int ci = clamp_cell(p.x - origin_.x, columns_), cj = clamp_cell(p.y - origin_.y, rows_);
  double best2 = std::numeric_limits<double>::infinity();
  const auto look = [&](int i, int j) {
    if (i < 0 || j < 0 || i >= columns_ || j >= rows_) return;
    for (const int s : buckets_[static_cast<std::size_t>(j) * columns_ + i]) {
      const auto [a, b] = segments_[s];
      const Vec2 ab = b - a, ap = p - a;
      const Vec2 w = ap - std::clamp(dot(ap, ab) / dot(ab, ab), 0.0, 1.0) * ab;
      best2 = std::min(best2, dot(w, w));
    }
  };
  // Searches rings of cells around p, from the inside out. Everything beyond ring r is at least r
  // cells away (farther if p is outside the grid).
  for (int r = 0; r <= std::max(columns_, rows_); ++r) {
    for (int i = ci - r; i <= ci + r; ++i) {
      look(i, cj - r);
      if (r > 0) look(i, cj + r);
    }
    for (int j = cj - r + 1; j < cj + r; ++j) {
      look(ci - r, j);
      look(ci + r, j);
    }
    if (best2 <= r * cell_mm_ * r * cell_mm_) break;
  }
  return inside(p) ? -std::sqrt(best2) : std::sqrt(best2);
}

}  // namespace trocar::sample
