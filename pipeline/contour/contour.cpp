// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/contour/contour.h"

#include <cstring>
#include <opencv2/imgproc.hpp>

#include "pipeline/contour/label_borders.h"

namespace trocar::pipeline {
namespace {

using DirectedEdge = std::pair<LatticePoint, LatticePoint>;

// Marching squares (Lorensen and Cline's idea in the plane), saddles by the asymptotic decider
// (Nielson and Hamann). The rings are valid by construction:
//  - A grid edge is crossed if and only if exactly one of its ends is inside (half-open test), so
//    it has one crossing point. A segment of the cell on one side ends there and a segment of the
//    cell on the other side starts there. Each segment thus has one successor, and loops close.
//  - The image is padded by one pixel that is outside, so no loop leaves it.
//  - A crossing stays 1/32 pixel, and at least two lattice steps, away from the grid points. All
//    points of one grid line snap to one lattice line in order. Snapped segments of a cell thus
//    keep their order on the cell's border, so two of them cannot cross.
// contour.h describes the position of a crossing on its grid edge.
class MarchingSquares {
 public:
  MarchingSquares(const Field& field, const PixelGrid& grid)
      : field_(field),
        image_(field.image),
        iso_(field.iso),
        grid_(grid),
        columns_(image_.width + 2),
        rows_(image_.height + 2) {}

  Pslg run() {
    scan();
    // The segment that starts on each grid edge. The table is kept between calls and not cleared,
    // because only entries written by this call are read.
    thread_local std::vector<std::uint32_t> segment_from;
    segment_from.resize(
        std::max(segment_from.size(), static_cast<std::size_t>(columns_) * rows_ * 2));
    for (std::uint32_t s = 0; s < segments_.size(); ++s)
      segment_from[segments_[s].from] = s;
    Pslg out;
    std::vector<Crossing> crossings;
    for (const Segment& first : segments_) {
      if (first.done) continue;
      crossings.clear();
      for (std::uint32_t s = segment_from[first.from]; !segments_[s].done;) {
        segments_[s].done = true;
        crossings.push_back(crossing_of(segments_[s].from));
        s = segment_from[segments_[s].to];
      }
      smooth_changed(crossings);
      if (!field_.is_mask) restore_chord_areas(crossings);
      Ring ring;
      ring.reserve(crossings.size());
      for (const Crossing& c : crossings)
        ring.push_back(snapped(c));
      out.rings.push_back(std::move(ring));
    }
    return out;
  }

 private:
  struct Segment {
    std::uint32_t from, to;  // grid edges, material on the left
    bool done = false;
  };

  // Finds the cells that the outline passes through: compares the inside flags of two neighbouring
  // rows eight columns at a time, and inspects single cells only where the flags are not all equal.
  // Columns where both rows are outside are skipped at once.
  void scan() {
    std::vector<std::uint8_t> below(static_cast<std::size_t>(columns_) + 8, 0), above = below;
    for (int y = 0; y + 1 < rows_; ++y) {
      const bool padded = y + 2 == rows_;
      const float* row =
          padded ? nullptr : &image_.values[static_cast<std::size_t>(y) * image_.width];
      for (int x = 0; x < image_.width; ++x)
        above[static_cast<std::size_t>(x) + 1] = !padded && row[x] >= iso_ ? 1 : 0;
      for (int x = 0; x + 1 < columns_;) {
        std::uint64_t lower = 0, upper = 0;
        std::memcpy(&lower, &below[static_cast<std::size_t>(x)], 8);
        std::memcpy(&upper, &above[static_cast<std::size_t>(x)], 8);
        constexpr std::uint64_t kOnes = 0x0101010101010101;
        if (lower == upper && lower == kOnes) {
          x += 7;  // seven cells between eight equal columns
          continue;
        }
        if ((lower | upper) == 0) {
          const auto first_inside = [this, x](const std::vector<std::uint8_t>& flags) {
            const void* const found = std::memchr(&flags[static_cast<std::size_t>(x)], 1,
                                                  static_cast<std::size_t>(columns_ - x));
            return found == nullptr
                       ? columns_
                       : static_cast<int>(static_cast<const std::uint8_t*>(found) - flags.data());
          };
          x = std::min(first_inside(below), first_inside(above)) - 1;
          continue;
        }
        // Each byte tells whether the corners of one cell differ. The last column has no cell.
        const int cells = std::min(7, columns_ - 1 - x);
        for (std::uint64_t mixed = ((lower ^ upper) | (lower ^ lower >> 8) | (upper ^ upper >> 8)) &
                                   ((std::uint64_t{1} << (8 * cells)) - 1);
             mixed != 0; mixed &= mixed - 1) {
          const int byte = std::countr_zero(mixed) & ~7;
          const auto in =
              static_cast<unsigned>((lower >> byte & 1) | (lower >> (byte + 8) & 1) << 1 |
                                    (upper >> (byte + 8) & 1) << 2 | (upper >> byte & 1) << 3);
          cell(x + byte / 8, y, in);
        }
        x += cells;
      }
      std::swap(below, above);
    }
  }

  // Padded grid: point (x, y) is pixel (x - 1, y - 1).
  bool padding(int x, int y) const {
    return x == 0 || y == 0 || x == columns_ - 1 || y == rows_ - 1;
  }
  float value(int x, int y) const { return padding(x, y) ? iso_ - 1.0F : image_.at(x - 1, y - 1); }
  // Grid edges: (x,y)-(x+1,y) is horizontal, (x,y)-(x,y+1) vertical.
  std::uint32_t horizontal(int x, int y) const {
    return 2U * (static_cast<std::uint32_t>(y) * columns_ + x);
  }
  std::uint32_t vertical(int x, int y) const { return horizontal(x, y) + 1; }

  // Corners a b c d counter-clockwise from (x, y). In this order a segment starts on the edge that
  // leaves the material and ends on the one that enters it: material is on its left.
  void cell(int x, int y, unsigned in) {
    const std::array<std::uint32_t, 4> edge = {horizontal(x, y), vertical(x + 1, y),
                                               horizontal(x, y + 1), vertical(x, y)};
    if (in != 5 && in != 10) {
      // Indexed by the set of inside corners: the segment runs from the edge after the last of them
      // to the edge before the first.
      constexpr std::array<std::uint8_t, 16> kFrom{0, 0, 1, 1, 2, 0, 2, 2, 3, 0, 0, 1, 3, 0, 3, 0},
          kTo{0, 3, 0, 3, 1, 0, 0, 3, 2, 2, 0, 2, 1, 1, 0, 0};
      segments_.push_back({edge[kFrom[in]], edge[kTo[in]]});
      return;
    }
    // A saddle. If the material is joined through the middle, a segment cuts off the outside corner
    // k + 1, otherwise the inside corner k.
    const bool is_joined =
        joined({value(x, y), value(x + 1, y), value(x + 1, y + 1), value(x, y + 1)});
    for (unsigned k = in == 5 ? 0 : 1; k < 4; k += 2)
      segments_.push_back({edge[k], edge[(is_joined ? k + 1 : k + 3) & 3]});
  }

  // Is the bilinear interpolant's saddle value inside?
  bool joined(const std::array<float, 4>& f) const {
    const double a = double{f[0]} - iso_, b = double{f[1]} - iso_, c = double{f[2]} - iso_,
                 d = double{f[3]} - iso_;
    const double denominator = a + c - b - d;  // > 0 iff a, c are the inside corners
    const double numerator = a * c - b * d;
    return denominator > 0 ? numerator >= 0 : numerator <= 0;
  }

  bool at_border(const Crossing& c) const {
    return padding(c.x, c.y) || padding(c.x + (c.along_v ? 0 : 1), c.y + (c.along_v ? 1 : 0));
  }

  // At the image's border the material ends at the pixel's edge, whatever its value. In a mask
  // every crossing is half way between two pixels.
  Crossing crossing_of(std::size_t edge) const {
    const int x = static_cast<int>(edge / 2 % columns_), y = static_cast<int>(edge / 2 / columns_);
    Crossing out{x, y, edge % 2 == 1, false, 0.5};
    const int dx = out.along_v ? 0 : 1, dy = 1 - dx;
    out.fixed = at_border(out);
    if (out.fixed || field_.is_mask) return out;
    GridLine line;
    const int at = out.along_v ? y : x, end = (out.along_v ? rows_ : columns_) - 2;
    line.first = std::max(0, 4 - at);
    line.last = std::min(7, 3 + end - at);
    const auto put = [&](int i) {
      line.value[static_cast<std::size_t>(i)] =
          double{image_.at(x - 1 + dx * (i - 3), y - 1 + dy * (i - 3))} - iso_;
    };
    if (line.first == 0 && line.last == 7) [[likely]] {
      for (int i = 0; i < 8; ++i)
        put(i);
    } else {
      for (int i = line.first; i <= line.last; ++i)
        put(i);
    }
    out.t = crossing(line);
    return out;
  }

  // Whether the outline passes there because exactly one of the two pixels was changed.
  bool is_changed(const Crossing& c) const {
    const std::size_t at = static_cast<std::size_t>(c.y - 1) * image_.width + c.x - 1;
    return !c.fixed && field_.changed[at] != field_.changed[at + (c.along_v ? image_.width : 1)];
  }

  // The values say nothing about where the border of a changed region lies between two pixels. It
  // is smoothed like that of a label, between the crossings that the values give.
  void smooth_changed(std::vector<Crossing>& ring) const {
    if (field_.changed.empty()) return;
    bool any = false;
    for (Crossing& c : ring) {
      c.fixed = !is_changed(c);
      if (c.fixed) continue;
      c.t = 0.5;
      any = true;
    }
    if (any) smooth_border(ring, std::nullopt);
    for (Crossing& c : ring)
      c.fixed = at_border(c);
  }

  LatticePoint snapped(const Crossing& c) const {
    const auto along = [&](int from, double spacing) {
      const std::int32_t low = grid_.lattice.snap_mm(from * spacing),
                         high = grid_.lattice.snap_mm((from + 1) * spacing);
      const std::int32_t at = grid_.lattice.snap_mm((from + c.t) * spacing);
      const std::int32_t margin = std::max(2, (high - low) / 32);
      return std::clamp(at, low + margin, high - margin);
    };
    const int px = c.x - 1 + grid_.offset_x, py = c.y - 1 + grid_.offset_y;
    if (c.along_v)
      return {grid_.lattice.snap_mm(px * grid_.spacing_u_mm), along(py, grid_.spacing_v_mm)};
    return {along(px, grid_.spacing_u_mm), grid_.lattice.snap_mm(py * grid_.spacing_v_mm)};
  }

  const Field& field_;
  const Image& image_;
  float iso_;
  PixelGrid grid_;
  int columns_, rows_;
  std::vector<Segment> segments_;
};

// Does direction b come before c when rotating clockwise from a? (All nonzero, from one point.)
bool clockwise_before(LatticePoint a, LatticePoint b, LatticePoint c) {
  const LatticePoint o{0, 0};
  // Sectors clockwise from a: right of a, opposite to a, left of a, and finally along a itself.
  const auto sector = [&](LatticePoint p) {
    const std::int64_t s = orient2d(o, a, p);
    if (s < 0) return 1;
    if (s > 0) return 3;
    return diametral_dot(a, p, o) > 0 ? 4 : 2;
  };
  if (sector(b) != sector(c)) return sector(b) < sector(c);
  return orient2d(o, b, c) < 0;
}

// Joins directed boundary edges (as many in as out at every point) into simple rings that touch at
// most in vertices. Opposite edges cancel, so material of zero width is dropped. At a point with
// several outgoing edges, the ring takes the first one clockwise from its incoming edge, which
// bounds the same wedge of material.
std::vector<Ring> simple_rings(std::vector<DirectedEdge> edges) {
  std::map<LatticePoint, std::vector<LatticePoint>> out;
  std::sort(edges.begin(), edges.end());
  std::map<DirectedEdge, int> count;
  for (const DirectedEdge& e : edges)
    ++count[e];
  for (const auto& [e, n] : count) {
    const auto opposite = count.find({e.second, e.first});
    const int left = n - (opposite == count.end() ? 0 : opposite->second);
    for (int i = 0; i < left; ++i)
      out[e.first].push_back(e.second);
  }
  std::vector<Ring> rings;
  for (auto& [start, outgoing] : out) {
    while (!outgoing.empty()) {
      // Follow the edges back to the start; a point visited twice closes a ring.
      std::vector<LatticePoint> path{start};
      std::map<LatticePoint, std::size_t> seen{{start, 0}};
      LatticePoint from = start, at = outgoing.back();
      outgoing.pop_back();
      while (true) {
        if (const auto it = seen.find(at); it != seen.end()) {
          const std::size_t first = it->second;
          Ring ring(path.begin() + static_cast<std::ptrdiff_t>(first), path.end());
          for (const LatticePoint& p : ring)
            seen.erase(p);
          path.resize(first);
          if (ring.size() >= 3 && doubled_area(ring) != 0) rings.push_back(std::move(ring));
          if (path.empty()) break;
        }
        seen[at] = path.size();
        path.push_back(at);
        std::vector<LatticePoint>& next = out[at];
        const LatticePoint back{from.x - at.x, from.y - at.y};
        auto best = next.begin();
        for (auto it = next.begin(); it != next.end(); ++it) {
          if (clockwise_before(back, {it->x - at.x, it->y - at.y},
                               {best->x - at.x, best->y - at.y}))
            best = it;
        }
        from = at;
        at = *best;
        next.erase(best);
      }
    }
  }
  return rings;
}

Pslg pixel_chains(const Field& field, const PixelGrid& grid) {
  const Image& image = field.image;
  cv::Mat mask(image.height, image.width, CV_8U);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x)
      mask.at<std::uint8_t>(y, x) = image.at(x, y) >= field.iso ? 1 : 0;
  }
  std::vector<std::vector<cv::Point>> chains;
  std::vector<cv::Vec4i> hierarchy;
  cv::findContours(mask, chains, hierarchy, cv::RETR_CCOMP, cv::CHAIN_APPROX_NONE);
  std::vector<DirectedEdge> edges;
  for (std::size_t c = 0; c < chains.size(); ++c) {
    Ring ring;
    for (const cv::Point& p : chains[c]) {
      ring.push_back({grid.lattice.snap_mm((p.x + grid.offset_x) * grid.spacing_u_mm),
                      grid.lattice.snap_mm((p.y + grid.offset_y) * grid.spacing_v_mm)});
    }
    // OpenCV orients outer and hole chains oppositely. Here outer chains are counter-clockwise.
    const bool hole = hierarchy[c][3] >= 0;
    if ((doubled_area(ring) < 0) != hole) std::reverse(ring.begin(), ring.end());
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const LatticePoint a = ring[i], b = ring[(i + 1) % ring.size()];
      if (a != b) edges.emplace_back(a, b);
    }
  }
  Pslg out;
  out.rings = simple_rings(std::move(edges));
  return out;
}

// The position of a jump between the constant values on both sides that gives the same sum of
// samples; nothing if the samples do not rise or fall monotonically between two constant values.
std::optional<double> jump_between_flats(const GridLine& line) {
  const auto& f = line.value;
  int from = 2, to = 5;
  while (from > line.first && f[from] != f[from - 1])
    --from;
  if (from <= line.first) return std::nullopt;
  while (to < line.last && f[to] != f[to + 1])
    ++to;
  if (to >= line.last) return std::nullopt;
  const double low = f[from], high = f[to], rise = high - low;
  // If the iso-value is not near the middle, its crossing depends on how blurred the edge is.
  if (!(std::abs(low + high) < 0.2 * std::abs(rise))) return std::nullopt;
  double at = from + 0.5 - 3;
  for (int i = from; i < to; ++i) {
    if ((f[i + 1] - f[i]) * rise < 0) return std::nullopt;
    if (i > from) at += (high - f[i]) / rise;
  }
  return std::clamp(at, 0.0, 1.0);
}

// Steffen's slope at a sample between the differences s and t: limited so that the interpolant does
// not overshoot.
double slope(double s, double t) {
  if (!(s * t > 0)) return 0;
  return std::copysign(2 * std::min({std::abs(s), std::abs(t), 0.25 * std::abs(s + t)}), s);
}

}  // namespace

Pslg contours(const Field& field, const PixelGrid& grid, ContourKind kind) {
  Pslg out =
      kind == ContourKind::kPixel ? pixel_chains(field, grid) : MarchingSquares(field, grid).run();
  normalise(out);
  return out;
}

void normalise(Pslg& outline) {
  for (Ring& ring : outline.rings)
    std::rotate(ring.begin(), std::min_element(ring.begin(), ring.end()), ring.end());
  std::sort(outline.rings.begin(), outline.rings.end());
}

Pslg drop_small_rings(Pslg contours, double min_area_mm2, const Lattice& lattice,
                      AreaChange* change) {
  const double step_mm2 = lattice.step_mm() * lattice.step_mm(),
               steps2 = 2 * min_area_mm2 / step_mm2;
  std::erase_if(contours.rings, [&](const Ring& ring) {
    const auto doubled = static_cast<double>(doubled_area(ring));
    if (!(std::abs(doubled) < steps2)) return false;
    if (change != nullptr)
      (doubled > 0 ? change->dropped_mm2 : change->filled_mm2) +=
          0.5 * std::abs(doubled) * step_mm2;
    return true;
  });
  return contours;
}

double crossing(const GridLine& line) {
  const auto& f = line.value;
  if (const auto jump = jump_between_flats(line)) return *jump;
  const double rise = f[4] - f[3];
  const double m3 = line.first <= 2 ? slope(f[3] - f[2], rise) : rise;
  const double m4 = line.last >= 5 ? slope(rise, f[5] - f[4]) : rise;
  const double c2 = 3 * rise - 2 * m3 - m4, c3 = m3 + m4 - 2 * rise;
  // Newton's method inside a bracket that shrinks with every value. The end of the bracket is
  // chosen without a branch, because the branch would be unpredictable.
  std::array<double, 2> bracket{0, 1};
  double t = f[3] / (f[3] - f[4]);
  for (int i = 0; i < 32; ++i) {
    const double value = f[3] + t * (m3 + t * (c2 + t * c3));
    bracket[(value >= 0) == (f[3] >= 0) ? 0 : 1] = t;
    const double step = value / (m3 + t * (2 * c2 + t * 3 * c3));
    const double next = t - step;
    if (std::abs(step) < 1e-6) break;
    t = next > bracket[0] && next < bracket[1] ? next : 0.5 * (bracket[0] + bracket[1]);
  }
  return t;
}

void restore_chord_areas(std::span<Crossing> ring) {
  constexpr double kMaxCurvature = 1;  // 1 / pixel; more is a corner
  constexpr double kMaxShift = 1.0 / 16;
  constexpr std::size_t kNeighbours = 3;  // neighbours on either side: about two pixels
  const std::size_t n = ring.size();
  const std::size_t neighbours = std::min(kNeighbours, (n - 1) / 3);
  if (n < 4) return;
  struct Offset {
    double u, v;
    double squared() const { return u * u + v * v; }
    double length() const { return std::sqrt(squared()); }
  };
  // The arrays below have one entry per crossing, and copies of the nearest `neighbours` entries
  // before the first and after the last, so that no index has to wrap round.
  const auto wrap = [n, neighbours](auto* values) {
    std::copy(values + n, values + n + neighbours, values);
    std::copy(values + neighbours, values + 2 * neighbours, values + n + neighbours);
  };
  // A crossing's position: the pixel before it (x, y) plus the offset (u, v) from there. Keeping
  // the two apart avoids rounding errors in differences.
  struct Position {
    double x, y, u, v;
  };
  thread_local std::vector<Position> all_positions;
  all_positions.resize(n + 2 * neighbours);
  Position* const positions = all_positions.data() + neighbours;
  for (std::size_t i = 0; i < n; ++i) {
    const double v = ring[i].along_v ? 1 : 0;
    positions[i] = {static_cast<double>(ring[i].x), static_cast<double>(ring[i].y),
                    (1 - v) * ring[i].t, v * ring[i].t};
  }
  wrap(all_positions.data());
  const auto step = [](const Position& a, const Position& b) {
    return Offset{b.x - a.x + (b.u - a.u), b.y - a.y + (b.v - a.v)};
  };
  // Each crossing accounts for half of the area that its two chords cut off. Curvature is that of
  // the circle through the crossing and its third neighbours on both sides, since nearer neighbours
  // would make it noisy. `gain` is the area that the polygon gains if the crossing moves by one
  // pixel along its grid line.
  struct ChordArea {
    double missing = 0, gain = 0;
  };
  thread_local std::vector<ChordArea> all_areas;
  all_areas.assign(n + 2 * neighbours, {});
  ChordArea* const areas = all_areas.data() + neighbours;
  for (std::size_t i = 0; i < n; ++i) {
    if (ring[i].fixed) continue;
    const Position* const at = positions + i;
    const Offset in = step(*(at - neighbours), *at), out = step(*at, *(at + neighbours));
    const double sides =
        std::sqrt(in.squared() * out.squared() * Offset{in.u + out.u, in.v + out.v}.squared());
    if (!(sides > 1e-9)) continue;
    const double curvature =
        std::clamp(2 * (in.u * out.v - in.v * out.u) / sides, -kMaxCurvature, kMaxCurvature);
    const Offset before = step(*(at - 1), *at), after = step(*at, *(at + 1));
    const double c1 = before.length(), c2 = after.length();
    areas[i].missing = curvature * (c1 * c1 * c1 + c2 * c2 * c2) / 24;
    areas[i].gain = ring[i].along_v ? -0.5 * (before.u + after.u) : 0.5 * (before.v + after.v);
  }
  wrap(all_areas.data());
  // The area missing around a crossing is spread over the neighbours in proportion to their gain: a
  // crossing whose grid line runs along the outline hardly moves.
  for (std::size_t i = 0; i < n; ++i) {
    double missing = 0, squares = 0;
    for (const ChordArea* area = areas + i - neighbours; area <= areas + i + neighbours; ++area) {
      missing += area->missing;
      squares += area->gain * area->gain;
    }
    if (squares > 1e-9)
      ring[i].t += std::clamp(areas[i].gain * missing / squares, -kMaxShift, kMaxShift);
  }
}

}  // namespace trocar::pipeline
