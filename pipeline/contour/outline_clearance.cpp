// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/contour/outline_clearance.h"

#include <cstdlib>

namespace trocar::pipeline {
namespace {

// The clearance for a tolerance: kClearance_steps, but at most half of the tolerance, because
// features above that size may be wanted. Result and `tolerance` are in lattice steps.
double clearance_steps(double tolerance) {
  return std::min(kClearance_steps, tolerance / 2);
}

using namespace collapse;  // collapse_geometry.h

constexpr int kSpotRounds = 8;            // rounds over all tight spots
constexpr double kRounding_steps = 0.75;  // a rounded point is nearer than this
// An outline with more tight spots than this for each edge, some of them found several times, is a
// figure at the scale of the lattice and stays as it is.
constexpr std::size_t kMaxSpots = 32;
// How many edges may be visited, for each edge of the outline and in any case.
constexpr std::int64_t kWork = 200, kMinWork = 100'000;
constexpr double kMaxMove = 2.5;  // largest move of a vertex, in clearances
// The parts of a ring's area and of the outline's area that may be wrong.
constexpr double kAreaError = 1e-5, kAreaErrorOfOutline = 2e-4;

bool is_off(std::int64_t error, std::int64_t area, double part) {
  return std::abs(static_cast<double>(error)) > part * std::abs(static_cast<double>(area));
}

class Clearing {
 public:
  // Contours and outline are in the canonical orientation, near the origin.
  Clearing(const Pslg& contours, const std::vector<bool>& is_open, LatticePoint origin,
           double tolerance, SimplifiedOutline& simplified)
      : origin_(origin),
        tolerance2_(tolerance * tolerance),
        clearance_(clearance_steps(tolerance)) {
    for (std::uint32_t r = 0; r < simplified.outline.rings.size(); ++r) {
      const Ring& ring = simplified.outline.rings[r];
      const auto first = static_cast<std::uint32_t>(nodes_.size()),
                 n = static_cast<std::uint32_t>(ring.size());
      const bool open = !is_open.empty() && is_open[r];
      rings_.push_back(
          {first, n, open ? first + n - 1 : kNone, doubled_area(ring), simplified.area_errors[r]});
      for (std::uint32_t k = 0; k < n; ++k) {
        nodes_.push_back({ring[k], first + (k > 0 ? k : n) - 1, first + (k + 1 < n ? k + 1 : 0), r,
                          simplified.positions[r][k]});
      }
      // position_within() reads a copy of the first point after the last one.
      Ring closed = contours.rings[r];
      closed.push_back(closed[0]);
      closed_contours_.push_back(std::move(closed));
    }
  }

  void run() {
    const std::int64_t work = kWork * static_cast<std::int64_t>(nodes_.size()) + kMinWork;
    work_left_ = work;
    for (int round = 0; round < kSpotRounds && clear_all(); ++round) {
    }
    work_left_ = work;
    std::vector<std::uint32_t> order;
    for (std::uint32_t r = 0; r < rings_.size(); ++r)
      if (is_off(rings_[r].area_error, rings_[r].doubled_area, kAreaError)) order.push_back(r);
    if (order.empty()) return;
    index_edges();
    std::sort(order.begin(), order.end(), [this](std::uint32_t r, std::uint32_t s) {
      return nodes_[smallest_node(r)].p < nodes_[smallest_node(s)].p;
    });
    for (const std::uint32_t r : order)
      restore_area(r);
  }

  void write_to(SimplifiedOutline& out) const {
    for (std::uint32_t r = 0; r < rings_.size(); ++r) {
      out.outline.rings[r].clear();
      std::uint32_t i = rings_[r].first;
      do {
        out.outline.rings[r].push_back(nodes_[i].p);
        i = nodes_[i].next;
      } while (i != rings_[r].first);
    }
  }

 private:
  static constexpr std::uint32_t kNone = 0xffffffff;

  struct OutlineNode {
    LatticePoint p;
    std::uint32_t previous, next;  // next is kNone if the node is removed
    std::uint32_t ring;
    ContourPosition position;
  };
  struct RingState {
    std::uint32_t first, size, end;  // end: the last node of a line, else kNone
    std::int64_t doubled_area, area_error;
  };
  // Two edges by their first nodes, or twice the same short edge.
  struct TightSpot {
    std::uint32_t i, j;
  };

  LatticeSegment edge(std::uint32_t i) const {
    const bool is_end = i == rings_[nodes_[i].ring].end;
    return {nodes_[i].p, is_end ? nodes_[i].p : nodes_[nodes_[i].next].p};
  }
  auto key(std::uint32_t i) const {
    const LatticeSegment s = edge(i);
    return std::tuple(s.a.x, s.a.y, s.b.x, s.b.y);
  }
  std::uint32_t alive(std::uint32_t i) const {
    while (nodes_[i].next == kNone)
      i = nodes_[i].previous;
    return i;
  }
  std::uint32_t smallest_node(std::uint32_t r) const {
    std::uint32_t best = rings_[r].first;
    for (std::uint32_t i = nodes_[best].next; i != rings_[r].first; i = nodes_[i].next)
      if (nodes_[i].p < nodes_[best].p) best = i;
    return best;
  }

  void index_edges() {
    indexed_.clear();
    edges_.clear();
    for (std::uint32_t i = 0; i < nodes_.size(); ++i) {
      if (nodes_[i].next == kNone) continue;
      indexed_.push_back(i);
      edges_.push_back(edge(i));
    }
    grid_.emplace(edges_, margin_of(clearance_));
    moved_.assign(nodes_.size(), 0);
    farthest_moved_ = 0;
  }

  // One round over all tight spots. Returns whether a step was made.
  bool clear_all() {
    index_edges();
    std::vector<TightSpot> spots;
    const std::size_t most = kMaxSpots * edges_.size();
    for_tight_spots(edges_, *grid_, clearance_, [&](std::uint32_t i, std::uint32_t j) {
      TightSpot s{indexed_[i], indexed_[j]};
      if (key(s.j) < key(s.i)) std::swap(s.i, s.j);
      if (spots.size() < most) spots.push_back(s);
    });
    if (spots.size() == most) return false;
    const auto order = [this](const TightSpot& s) {
      return std::tuple(s.i != s.j, key(s.i), key(s.j));
    };
    std::sort(spots.begin(), spots.end(),
              [&](const TightSpot& s, const TightSpot& t) { return order(s) < order(t); });
    bool any = false;
    for (const TightSpot& s : spots) {
      if (work_left_ <= 0) return false;
      const std::uint32_t i = alive(s.i), j = alive(s.j);
      if (s.i == s.j ? i == s.i && is_short(edge(i), clearance_) && widen_or_merge(i)
                     : i != j && is_tight(edge(i), edge(j), clearance_) && separate(i, j))
        any = true;
    }
    return any;
  }

  // Merges the ends of a short edge, or else moves one of them away from the other.
  bool widen_or_merge(std::uint32_t b) {
    const std::uint32_t c = nodes_[b].next;
    const Point at_b = point(nodes_[b].p), at_c = point(nodes_[c].p);
    const Point middle{(at_b.x + at_c.x) / 2, (at_b.y + at_c.y) / 2};
    if (const auto path = path_through(b, 2)) {
      const LatticePoint a = path->a(), d = path->d();
      const double base2 = static_cast<double>(distance2(a, d));
      const RingState& ring = rings_[nodes_[b].ring];
      if (base2 > 0) {
        const double base = std::sqrt(base2),
                     area = static_cast<double>(doubled(*path)) +
                            std::clamp(static_cast<double>(ring.area_error), -base, base);
        const Point from = point(a), to = point(d);
        const double now =
            (middle.x - to.x) * (from.y - to.y) - (middle.y - to.y) * (from.x - to.x);
        // The point that keeps the area, on the normal of a-d through the middle.
        const double offset = (now - area) / base2;
        const Point ideal{middle.x - offset * (to.y - from.y), middle.y + offset * (to.x - from.x)};
        const auto near = nearest(ideal);
        if (near && replace(*path, rounded(a, d, *near, ideal, area))) return true;
      }
      for (const Point p : {middle, at_b, at_c}) {
        const auto e = nearest(p);
        if (e && replace(*path, *e)) return true;
      }
    }
    const double length = std::sqrt(distance2_between(at_b, at_c)),
                 more = (clearance_ - length + kRounding_steps) / length;
    return move(c, {more * (at_c.x - at_b.x), more * (at_c.y - at_b.y)}) ||
           move(b, {more * (at_b.x - at_c.x), more * (at_b.y - at_c.y)});
  }

  // Moves a vertex of one of two edges away from the other edge.
  bool separate(std::uint32_t i, std::uint32_t j) {
    struct Gap {
      double distance2;
      std::uint32_t vertex, from, to;  // to: the end of the edge from `from`
    };
    std::vector<Gap> gaps;
    const auto add = [&](std::uint32_t vertex, std::uint32_t from) {
      const std::uint32_t to = nodes_[from].next;
      gaps.push_back(
          {segment_distance2(point(nodes_[from].p), point(nodes_[to].p), point(nodes_[vertex].p)),
           vertex, from, to});
    };
    for (const auto& [s, t] : {std::pair{i, j}, std::pair{j, i}}) {
      if (s == rings_[nodes_[s].ring].end || t == rings_[nodes_[t].ring].end) return false;
      add(s, t);
      add(nodes_[s].next, t);
    }
    std::sort(gaps.begin(), gaps.end(), [this](const Gap& s, const Gap& t) {
      return std::tuple(s.distance2, nodes_[s.vertex].p, key(s.from)) <
             std::tuple(t.distance2, nodes_[t.vertex].p, key(t.from));
    });
    for (const Gap& gap : gaps) {
      if (!(gap.distance2 > 0 && gap.distance2 < clearance_ * clearance_)) continue;
      const Point v = point(nodes_[gap.vertex].p), from = point(nodes_[gap.from].p),
                  to = point(nodes_[gap.to].p);
      const double t = fraction_along(from, to, v), distance = std::sqrt(gap.distance2),
                   need = (clearance_ - distance + kRounding_steps) / distance;
      const Point away{need * (v.x - from.x - t * (to.x - from.x)),
                       need * (v.y - from.y - t * (to.y - from.y))};
      if (move(gap.vertex, away)) return true;
      if (t < 1 && move(gap.from, {-away.x / (1 - t), -away.y / (1 - t)})) return true;
      if (t > 0 && move(gap.to, {-away.x / t, -away.y / t})) return true;
    }
    return false;
  }

  bool move(std::uint32_t i, Point by) {
    const double most = kMaxMove * clearance_;
    if (by.x * by.x + by.y * by.y > most * most) return false;
    const auto e = nearest({nodes_[i].p.x + by.x, nodes_[i].p.y + by.y});
    const auto path = path_through(i, 1);
    return e && path && replace(*path, *e);
  }

  // The path through `inner` nodes from i on, with one node before and one after it; nothing if it
  // would include the ends of a line, or the same node twice.
  std::optional<Path> path_through(std::uint32_t i, std::size_t inner) const {
    const RingState& ring = rings_[nodes_[i].ring];
    if (ring.size < inner + 2) return std::nullopt;
    Path path;
    path.size = inner + 2;
    std::uint32_t node = nodes_[i].previous;
    for (std::size_t k = 0; k < path.size; ++k) {
      if (node == ring.end && k + 1 < path.size) return std::nullopt;
      path.nodes[k] = node;
      path.points[k] = nodes_[node].p;
      node = nodes_[node].next;
    }
    return path;
  }

  static std::int64_t doubled(const Path& path) {
    std::int64_t out = 0;
    for (std::size_t k = 1; k + 1 < path.size; ++k)
      out += orient2d(path.points[0], path.points[k], path.points[k + 1]);
    return out;
  }

  // Lists the nodes of the edges near the box that are not edges of the path.
  void list_near(const LatticeBox& box, const Path& path) {
    near_.clear();
    // An edge lies near its indexed place: its ends have moved, or were merged by a short edge.
    const auto most = static_cast<std::int32_t>(std::ceil(farthest_moved_ + clearance_));
    const LatticeBox around = widened(box, margin_of(clearance_));
    grid_->for_each_near(widened(around, most), [&](std::uint32_t k) {
      --work_left_;
      const std::uint32_t i = alive(indexed_[k]);
      const LatticeSegment s = edge(i);
      if (apart(box_around(s.a, s.b), around)) return;
      const auto last = path.nodes.begin() + static_cast<std::ptrdiff_t>(path.size) - 1;
      if (std::find(path.nodes.begin(), last, i) == last) near_.push_back(i);
    });
    std::sort(near_.begin(), near_.end());
    near_.erase(std::unique(near_.begin(), near_.end()), near_.end());
  }

  // The tight spots of consecutive edges through the points, with each other and with near_.
  int tight_spots(std::span<const LatticePoint> points) const {
    int out = 0;
    for (std::size_t k = 0; k + 1 < points.size(); ++k) {
      const LatticeSegment s{points[k], points[k + 1]};
      if (is_short(s, clearance_)) ++out;
      for (std::size_t m = k + 2; m + 1 < points.size(); ++m)
        if (is_tight(s, {points[m], points[m + 1]}, clearance_)) ++out;
      for (const std::uint32_t i : near_)
        if (is_tight(s, edge(i), clearance_)) ++out;
    }
    return out;
  }

  // Replaces the path's inner nodes by the point e, if that is allowed and leaves fewer tight spots
  // (or, with `may_stay`, as many).
  bool replace(Path path, LatticePoint e, bool may_stay = false) {
    const LatticePoint a = path.a(), d = path.d();
    RingState& ring = rings_[nodes_[path.nodes[0]].ring];
    const std::size_t removed = path.size - 3;
    const std::uint32_t b = path.nodes[1], size = ring.size - static_cast<std::uint32_t>(removed);
    if (a == d || e == a || e == d || (ring.end == kNone && size < 3) ||
        !is_on_lattice({e.x + origin_.x, e.y + origin_.y}))
      return false;
    const double moved = moved_[b] + std::sqrt(static_cast<double>(distance2(path.points[1], e)));
    if (moved > 2 * kMaxMove * clearance_) return false;
    const std::int64_t side = orient2d(a, e, d);
    if (side == 0 && !is_inside_segment(a, d, e)) return false;
    if (ring.end == kNone && size == 3 && (side == 0 || (side > 0) != (ring.doubled_area > 0)))
      return false;
    path.points[path.size] = e;
    LatticeBox box = box_around(a, e);
    for (std::size_t k = 1; k < path.size; ++k)
      widen(box, path.points[k]);
    const auto position = position_within(contour_part(path), a, d, e, tolerance2_);
    if (!position) return false;
    list_near(box, path);
    const std::uint32_t closing =
        ring.end == kNone && size == 3 ? path.nodes[path.size - 1] : kNone;
    for (const std::uint32_t i : near_) {
      if (i == closing) continue;
      const LatticeSegment s = edge(i);
      if (!apart(box_around(s.a, s.b), box) &&
          meets(path, box, s.a, s.b, i == rings_[nodes_[i].ring].end))
        return false;
    }
    const int before = tight_spots({path.points.data(), path.size}),
              after = tight_spots(std::array{a, e, d});
    if (after > before || (after == before && !may_stay)) return false;

    ring.area_error -= side - doubled(path);
    ring.size = size;
    const std::uint32_t last = path.nodes[path.size - 1];
    for (std::size_t k = 2; k + 1 < path.size; ++k) {
      if (ring.first == path.nodes[k]) ring.first = b;
      nodes_[path.nodes[k]].next = kNone;
      nodes_[path.nodes[k]].previous = b;
    }
    nodes_[b].p = e;
    nodes_[b].position = *position;
    nodes_[b].next = last;
    nodes_[last].previous = b;
    moved_[b] = moved;
    farthest_moved_ = std::max(farthest_moved_, moved);
    return true;
  }

  ContourPart contour_part(const Path& path) const {
    const OutlineNode &from = nodes_[path.nodes[0]], &to = nodes_[path.nodes[path.size - 1]];
    const Ring& contour = closed_contours_[from.ring];
    return {contour.data(), static_cast<std::uint32_t>(contour.size() - 1), from.position,
            to.position};
  }

  // Moves vertices of the ring by up to two steps until its area is right.
  void restore_area(std::uint32_t r) {
    RingState& ring = rings_[r];
    const std::uint32_t start = smallest_node(r);
    bool any = true;
    for (int round = 0; round < kSpotRounds && any; ++round) {
      any = false;
      std::uint32_t i = start;
      do {
        if (work_left_ <= 0 || !is_off(ring.area_error, ring.doubled_area, kAreaError)) return;
        any = restore_area_at(i) || any;
        i = nodes_[i].next;
      } while (i != start);
    }
  }
  bool restore_area_at(std::uint32_t i) {
    const std::optional<Path> path = path_through(i, 1);
    if (!path) return false;
    const LatticePoint a = path->a(), d = path->d(), b = path->points[1];
    const std::int64_t error = rings_[nodes_[i].ring].area_error, per_x = std::int64_t{d.y} - a.y,
                       per_y = std::int64_t{a.x} - d.x;
    struct Offset {
      std::int64_t error;
      std::int32_t length2, x, y;
      bool operator<(const Offset& o) const {
        return std::tie(error, length2, x, y) < std::tie(o.error, o.length2, o.x, o.y);
      }
    };
    Offset best{std::abs(error), 0, 0, 0};
    for (std::int32_t x = -2; x <= 2; ++x) {
      for (std::int32_t y = -2; y <= 2; ++y)
        best = std::min(best, {std::abs(error - x * per_x - y * per_y), x * x + y * y, x, y});
    }
    // Only a substantial gain is worth a step: a tenth of the error, or a step of the vertex.
    const double gain = static_cast<double>(std::abs(error) - best.error),
                 step = std::sqrt(static_cast<double>(distance2(a, d)));
    return (10 * gain >= static_cast<double>(std::abs(error)) || gain >= step) &&
           best.error < std::abs(error) && replace(*path, {b.x + best.x, b.y + best.y}, true);
  }

  LatticePoint origin_;
  double tolerance2_, clearance_;
  std::vector<OutlineNode> nodes_;
  std::vector<RingState> rings_;
  std::vector<Ring> closed_contours_;
  std::vector<std::uint32_t> indexed_;  // by edge of the grid: its node when it was indexed
  std::vector<LatticeSegment> edges_;
  std::optional<SegmentGrid> grid_;
  std::vector<double> moved_;  // by node: distance moved since the edges were indexed
  double farthest_moved_ = 0;
  std::int64_t work_left_ = 0;
  std::vector<std::uint32_t> near_;
};

bool lacks_area(const SimplifiedOutline& outline) {
  std::int64_t error = 0;
  for (const std::int64_t e : outline.area_errors)
    error += e;
  return is_off(error, doubled_area(outline.outline), kAreaErrorOfOutline);
}

}  // namespace

void clear_outline(const Pslg& contours, const std::vector<bool>& is_open, double tolerance,
                   SimplifiedOutline& simplified) {
  const double clearance = clearance_steps(tolerance);
  if (clearance < 1 || (!lacks_area(simplified) &&
                        !has_tight_spots(edges_of(simplified.outline, is_open), clearance)))
    return;
  const CanonicalFrame frame(contours);
  Pslg moved = contours;
  frame.enter(moved.rings);
  frame.enter(simplified.outline.rings);
  Clearing clearing(moved, is_open, frame.box().low, tolerance, simplified);
  clearing.run();
  clearing.write_to(simplified);
  frame.leave(simplified.outline.rings);
}

}  // namespace trocar::pipeline
