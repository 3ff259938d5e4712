// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/refinement_outline.h"

#include "formats/mesh/edge_table.h"

namespace trocar {
namespace {

constexpr double kSmallInputAngle_deg = 60;
// Two segments farther apart than this, in lattice steps, do not meet if each bulges by one step.
constexpr std::int32_t kNearby_steps = 4;

// Returns the radius of a shell around a corner that lies well inside (near, far). The candidates,
// in this order, are the same for every segment: the powers of two, the geometric mean of two
// successive powers, then repeated halves of the intervals. (Shells in the ratio sqrt(2) leave no
// angle below 32 degrees between segments that meet under 30 or more; the ratio 2 leaves 26.)
double shell_between(double near, double far) {
  const double low = near + 0.25 * (far - near), high = far - 0.25 * (far - near);
  double power = 1;
  while (power * 2 <= high)
    power *= 2;
  if (power >= low) return power;
  double from = power, to = 2 * power, middle = power * std::numbers::sqrt2;
  for (int depth = 0; depth < 20; ++depth) {
    if (middle >= low && middle <= high) return middle;
    (middle < low ? from : to) = middle;
    middle = 0.5 * (from + to);
  }
  return 0.5 * (near + far);
}

// Squared distance from p to the segment ab.
double distance2_to(LatticePoint a, LatticePoint b, LatticePoint p) {
  if (diametral_dot(b, p, a) <= 0) return static_cast<double>(distance2(a, p));
  if (diametral_dot(a, p, b) <= 0) return static_cast<double>(distance2(b, p));
  const auto area = static_cast<double>(orient2d(a, b, p));
  return area * area / static_cast<double>(distance2(a, b));
}

// Are two segments that do not cross within kNearby_steps of each other?
bool are_near(LatticePoint a, LatticePoint b, LatticePoint c, LatticePoint d) {
  return std::min({distance2_to(a, b, c), distance2_to(a, b, d), distance2_to(c, d, a),
                   distance2_to(c, d, b)}) <= double{kNearby_steps} * kNearby_steps;
}

// Finds the next vertex on the boundary, which has the material on its left, for each vertex. The
// mesh is a manifold (a pinch is two vertices), so there is at most one.
std::vector<std::uint32_t> next_on_boundary(const SliceMesh& mesh) {
  std::vector<std::uint32_t> next(mesh.vertices.size());
  edge_table(mesh).for_each_pair([&](std::uint32_t low, std::uint32_t high, const auto& edges) {
    if (edges.size() == 1) {
      const std::uint32_t edge = edges[0].edge, from = mesh.triangles[edge / 3][edge % 3];
      next[from] = from == low ? high : low;
    }
    return true;
  });
  return next;
}

}  // namespace

void RefinementOutline::clear(std::size_t vertices) {
  segments_.clear();
  segments_.reserve(vertices);
  twins_.clear();
  into_.assign(vertices, -1);
  angle_deg_.assign(vertices, 360);
}

std::uint32_t RefinementOutline::add(std::uint32_t from, std::uint32_t to) {
  const auto s = static_cast<std::uint32_t>(segments_.size());
  segments_.push_back({from, to, -1, 360});
  into_[to] = static_cast<std::int32_t>(s);
  return s;
}

void RefinementOutline::close(const std::vector<LatticePoint>& points) {
  for (Refined::Segment& s : segments_) {
    s.previous = into_[s.from];
    const LatticePoint v = points[s.from], n = points[s.to],
                       p = points[segments_[static_cast<std::size_t>(s.previous)].from];
    const std::int64_t cross = orient2d(v, n, p), dot = diametral_dot(n, p, v);
    if (cross <= 0 || dot <= 0) continue;
    s.angle_at_from_deg =
        std::atan2(static_cast<double>(cross), static_cast<double>(dot)) * 180 / std::numbers::pi;
    angle_deg_[s.from] = s.angle_at_from_deg;
  }
}

void RefinementOutline::find_twins(const std::vector<LatticePoint>& points) {
  const auto n = static_cast<std::uint32_t>(segments_.size());
  // The ends of each segment, the smaller one first, and its number.
  std::vector<std::pair<std::pair<LatticePoint, LatticePoint>, std::uint32_t>> items;
  items.reserve(n);
  for (std::uint32_t s = 0; s < n; ++s)
    items.emplace_back(std::minmax(points[segments_[s].from], points[segments_[s].to]), s);
  std::sort(items.begin(), items.end());
  twins_.assign(n, kNoTwin);
  for (std::uint32_t k = 0; k + 1 < n; ++k) {
    const auto& [ends, s] = items[k];
    const auto& [next_ends, t] = items[k + 1];
    if (ends == next_ends) twins_[s] = t, twins_[t] = s;
  }
}

// Do this segment and its predecessor have the same region, or void, beyond them? Two shared
// segments do if they are neighbours on the other side too.
bool RefinementOutline::is_one_loop_with_previous(std::uint32_t segment) const {
  const std::uint32_t here = twin(segment),
                      before = twin(static_cast<std::uint32_t>(segments_[segment].previous));
  if (here == kNoTwin || before == kNoTwin) return here == before;
  return segments_[before].previous == static_cast<std::int32_t>(here);
}

void RefinementOutline::find_loops() {
  const auto n = static_cast<std::uint32_t>(segments_.size());
  constexpr std::uint32_t kNone = 0xffffffff;
  loop_.assign(n, kNone);
  lost_.clear();
  for (std::uint32_t first = 0; first < n; ++first) {
    if (loop_[first] != kNone) continue;
    const auto loop = static_cast<std::uint32_t>(lost_.size());
    lost_.push_back(0);
    std::uint32_t s = first;
    loop_[s] = loop;
    while (twins_.empty() || is_one_loop_with_previous(s)) {
      s = static_cast<std::uint32_t>(segments_[s].previous);
      if (loop_[s] != kNone) break;
      loop_[s] = loop;
    }
    // If the walk ran into a loop that an earlier walk entered in its middle, this part belongs to
    // it.
    for (std::uint32_t t = first; loop_[s] != loop && loop_[t] == loop;
         t = static_cast<std::uint32_t>(segments_[t].previous))
      loop_[t] = loop_[s];
  }
}

void RefinementOutline::start_clearance(const std::vector<LatticePoint>& points) {
  clearance_.assign(segments_.size(), Clearance::kUnknown);
  ends_.resize(segments_.size());
  next_.resize(segments_.size());
  for (std::uint32_t s = 0; s < segments_.size(); ++s) {
    ends_[s] = {points[segments_[s].from], points[segments_[s].to]};
    next_[static_cast<std::size_t>(segments_[s].previous)] = s;
  }
  grid_.reset();
}

void RefinementOutline::find_clearance(std::uint32_t segment) {
  const auto previous = static_cast<std::uint32_t>(segments_[segment].previous),
             next = next_[segment];
  const auto [a, b] = ends_[segment];
  // The void must not be acute at a corner, since the two segments are near each other there.
  const auto is_void_acute = [](LatticePoint p, LatticePoint v, LatticePoint q) {
    return (orient2d(p, v, q) < 0) & (diametral_dot(p, q, v) > 0);
  };
  clearance_[segment] = Clearance::kNo;
  if (is_void_acute(ends_[previous].a, a, b) | is_void_acute(a, b, ends_[next].b)) return;
  if (!grid_) grid_.emplace(ends_, kNearby_steps);
  const LatticeBox box = widened(box_around(a, b), kNearby_steps);
  bool is_any_near = false;
  grid_->for_each_near(ends_[segment], [&, a = a, b = b](std::uint32_t t) {
    const auto& [c, d] = ends_[t];
    if ((t == segment) | (t == previous) | (t == next) | apart(box, box_around(c, d))) [[likely]]
      return;
    is_any_near = is_any_near || are_near(a, b, c, d);
  });
  if (!is_any_near) clearance_[segment] = Clearance::kYes;
}

std::uint32_t RefinementOutline::small_corner_of_two(std::int32_t s, std::int32_t t) const {
  const Refined::Segment &from_s = segments_[static_cast<std::size_t>(s)],
                         &from_t = segments_[static_cast<std::size_t>(t)];
  if (from_s.previous == t && from_s.angle_at_from_deg < kSmallInputAngle_deg) return from_s.from;
  if (from_t.previous == s && from_t.angle_at_from_deg < kSmallInputAngle_deg) return from_t.from;
  return kNoCorner;
}

double RefinementOutline::shell_fraction(std::uint32_t segment, LatticePoint a, LatticePoint b,
                                         const std::vector<LatticePoint>& points) const {
  double fraction = 0.5, nearest = std::numeric_limits<double>::max();
  for (const bool is_from : {true, false}) {
    if (!(is_from ? is_acute_from(segment) : is_acute_to(segment))) continue;
    const std::uint32_t corner = is_from ? segments_[segment].from : segments_[segment].to;
    const double da = edge_length(a, points[corner]), db = edge_length(b, points[corner]);
    const double near = std::min(da, db), far = std::max(da, db);
    if (near >= nearest) continue;
    nearest = near;
    fraction = (shell_between(near, far) - near) / (far - near);
    if (db < da) fraction = 1 - fraction;
  }
  return fraction;
}

std::array<std::optional<LatticePoint>, 2> shared_split_points(LatticePoint a, LatticePoint b,
                                                               LatticePoint c, LatticePoint d,
                                                               double fraction, std::int64_t lost) {
  const std::optional<LatticePoint> here = split_near(a, b, c, fraction);
  if (here && orient2d(a, b, *here) == 0) return {here, {}};
  const std::optional<LatticePoint> there = split_near(b, a, d, 1 - fraction);
  if (!here || !there) return {here ? here : there, {}};
  if (std::abs(lost + orient2d(a, b, *there)) < std::abs(lost + orient2d(a, b, *here)))
    return {there, here};
  return {here, there};
}

bool may_split_either_way(const RefinementMesh& mesh, EdgeId edge, LatticePoint p) {
  const auto [ia, ib] = mesh.ends(edge);
  const LatticePoint a = mesh.points[ia], b = mesh.points[ib];
  if (orient2d(a, b, p) >= 0) return may_split(a, b, mesh.points[mesh.apex(edge)], p);
  return encroaches(a, b, p) && mesh.circumcircle_contains(triangle_of(edge), p);
}

Pslg refined_rings(const Refined& refined, const Pslg& outline) {
  const std::vector<LatticePoint>& points = refined.mesh.vertices;
  const std::vector<std::uint32_t> next = next_on_boundary(refined.mesh);
  // Segments are looked up by their two ends, which no two segments share.
  const auto ends = [&points](const Refined::Segment& s) {
    return std::pair{points[s.from], points[s.to]};
  };
  std::vector<Refined::Segment> segments = refined.segments;
  std::sort(segments.begin(), segments.end(),
            [&ends](const auto& s, const auto& t) { return ends(s) < ends(t); });
  Pslg out;
  for (const Ring& ring : outline.rings) {
    Ring& stored = out.rings.emplace_back();
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const std::pair wanted{ring[i], ring[(i + 1) % ring.size()]};
      const auto s =
          std::lower_bound(segments.begin(), segments.end(), wanted,
                           [&ends](const auto& t, const auto& w) { return ends(t) < w; });
      for (std::uint32_t v = s->from; v != s->to; v = next[v])
        stored.push_back(points[v]);
    }
  }
  return out;
}

}  // namespace trocar
