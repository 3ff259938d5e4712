// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/contour/outline_distance.h"

#include <limits>

#include "pipeline/contour/simplification.h"

namespace trocar::pipeline {
namespace {

std::vector<OutlineEdge> edges_of(std::span<const OutlineRing> rings) {
  std::vector<OutlineEdge> out;
  for (const OutlineRing& ring : rings) {
    for (std::size_t i = 0; i < ring.size(); ++i)
      out.push_back({ring[i], ring[i + 1 < ring.size() ? i + 1 : 0]});
  }
  return out;
}

struct MeasuredEnd {
  Point p;
  AabbTree::Nearest near;
};

// The edges of a ring or line to which distances are measured.
class Target : public AabbTree {
 public:
  Target(const Ring& ring, bool is_open) : AabbTree(edges_of(ring, is_open)), is_open_(is_open) {}

  // Are all vertices from edge i forwards to edge j within the squared distance d2 of the segment
  // ab? If moreover a is as near to edge i and b to edge j, then the whole segment is as near to
  // the path between these edges: as a point runs along the path, its nearest point on the segment
  // runs from one end of the segment to the other.
  bool is_path_near(std::size_t i, std::size_t j, Point a, Point b, double d2) const {
    const std::size_t n = size();
    if (is_open_ && j < i) return false;
    for (std::size_t steps = 0; i != j; ++steps) {
      i = i + 1 < n ? i + 1 : 0;
      if (2 * steps > n || segment_distance2(a, b, edge(i)[0]) > d2) return false;
    }
    return true;
  }

 private:
  static std::vector<OutlineEdge> edges_of(const Ring& ring, bool is_open) {
    std::vector<OutlineEdge> out;
    out.reserve(ring.size());
    for (std::size_t i = 0; i + 1 < ring.size(); ++i)
      out.push_back({point(ring[i]), point(ring[i + 1])});
    if (!is_open) out.push_back({point(ring.back()), point(ring.front())});
    return out;
  }

  bool is_open_;
};

// An end of a segment and an edge near it, which is nearly always the nearest one.
struct SegmentEnd {
  Point p;
  Target::Nearest near;
};

// Relative accuracy of squared distances: a segment that may exceed the largest one found by less
// than this fraction is not halved any further.
constexpr double kRelativeAccuracy = 2e-10;
constexpr int kMaxHalvings = 40;
// Number of edges after the previous nearest edge that are inspected before a search in the tree. A
// contour has about six edges for each edge of its simplified ring.
constexpr int kMaxInspectedEdges = 16;

// Raises worst2 to the largest squared distance from the segment a-b to the target. The distance to
// one edge is convex along the segment, so that the ends bound it. If neither a common edge nor the
// path between the two ends' edges gives a good bound, the segment is halved.
void raise_by_segment(const Target& to, SegmentEnd a, SegmentEnd b, int halvings, double& worst2) {
  const auto bound2 = [&] {
    if (a.near.edge == b.near.edge) return std::max(a.near.d2, b.near.d2);
    return std::min(std::max(a.near.d2, to.to_edge(b.p, a.near.edge)),
                    std::max(b.near.d2, to.to_edge(a.p, b.near.edge)));
  };
  const double enough2 = worst2 * (1 + kRelativeAccuracy);
  if (bound2() <= enough2) return;
  if (std::max(a.near.d2, b.near.d2) <= enough2 &&
      to.is_path_near(a.near.edge, b.near.edge, a.p, b.p, enough2))
    return;
  for (SegmentEnd* end : {&a, &b}) {
    end->near = to.nearest(end->p, end->near.edge);
    worst2 = std::max(worst2, end->near.d2);
  }
  const double most2 = bound2();
  if (most2 <= worst2 * (1 + kRelativeAccuracy)) return;
  if (halvings == kMaxHalvings) {
    worst2 = std::max(worst2, most2);
    return;
  }
  const Point middle{0.5 * (a.p.x + b.p.x), 0.5 * (a.p.y + b.p.y)};
  const SegmentEnd m{middle, to.nearest(middle, a.near.edge)};
  worst2 = std::max(worst2, m.near.d2);
  raise_by_segment(to, a, m, halvings + 1, worst2);
  raise_by_segment(to, m, b, halvings + 1, worst2);
}

// Raises `worst` to the largest distance from the segment a-b to the target, within the accuracy.
// The distance to one edge is convex along the segment, so its largest value is at an end. The
// distance to all edges changes by no more than the length travelled along the segment.
void raise_by_segment(const AabbTree& to, const MeasuredEnd& a, const MeasuredEnd& b,
                      double accuracy, double& worst) {
  const double length = std::sqrt(distance2_between(a.p, b.p));
  const double by_a = std::max(a.near.d2, to.to_edge(b.p, a.near.edge)),
               by_b = std::max(b.near.d2, to.to_edge(a.p, b.near.edge));
  const double bound = std::min(std::sqrt(std::min(by_a, by_b)),
                                (std::sqrt(a.near.d2) + std::sqrt(b.near.d2) + length) / 2);
  if (bound <= worst + accuracy) return;
  const Point middle{0.5 * (a.p.x + b.p.x), 0.5 * (a.p.y + b.p.y)};
  const MeasuredEnd m{middle, to.nearest(middle, a.near.edge)};
  worst = std::max(worst, std::sqrt(m.near.d2));
  raise_by_segment(to, a, m, accuracy, worst);
  raise_by_segment(to, m, b, accuracy, worst);
}

void raise(const std::vector<OutlineEdge>& from, const AabbTree& to, double accuracy,
           double& worst) {
  std::size_t guess = 0;
  for (const OutlineEdge& edge : from) {
    const MeasuredEnd a{edge[0], to.nearest(edge[0], guess)};
    const MeasuredEnd b{edge[1], to.nearest(edge[1], a.near.edge)};
    worst = std::max({worst, std::sqrt(a.near.d2), std::sqrt(b.near.d2)});
    raise_by_segment(to, a, b, accuracy, worst);
    guess = b.near.edge;
  }
}

void raise_by_ring(const Ring& from, const Ring& ring, bool is_open, double& worst2) {
  const Target to(ring, is_open);
  // Both rings have the same orientation, so that the nearest edge is often the previous vertex's
  // or one of the next. An edge that is near enough suffices even if it is not the nearest.
  const auto end_at = [&](LatticePoint at, std::size_t& edge) {
    const Point p = point(at);
    Target::Nearest near{to.to_edge(p, edge), edge};
    for (int k = 0; k < kMaxInspectedEdges && near.d2 > worst2; ++k) {
      edge = edge + 1 < to.size() ? edge + 1 : 0;
      const double d2 = to.to_edge(p, edge);
      if (d2 < near.d2) near = {d2, edge};
    }
    if (near.d2 > worst2) near = to.nearest(p, near.edge);
    worst2 = std::max(worst2, near.d2);
    edge = near.edge;
    return SegmentEnd{p, near};
  };
  std::size_t edge = to.nearest(point(from[0]), 0).edge;
  const SegmentEnd first = end_at(from[0], edge);
  SegmentEnd a = first;
  for (std::size_t i = 1; i < from.size() + (is_open ? 0 : 1); ++i) {
    const SegmentEnd b = i < from.size() ? end_at(from[i], edge) : first;
    raise_by_segment(to, a, b, 0, worst2);
    a = b;
  }
}

}  // namespace

AabbTree::AabbTree(std::vector<OutlineEdge> edges) : edges_(std::move(edges)) {
  levels_.emplace_back();
  for (std::size_t i = 0; i < edges_.size(); ++i) {
    if (i % kFan == 0) levels_[0].push_back({edges_[i][0], edges_[i][0]});
    for (const Point p : edges_[i])
      widen(levels_[0].back(), {p, p});
  }
  while (levels_.back().size() > 1) {
    std::vector<Box> above;
    const std::vector<Box>& below = levels_.back();
    for (std::size_t i = 0; i < below.size(); ++i) {
      if (i % kFan == 0) above.push_back(below[i]);
      widen(above.back(), below[i]);
    }
    levels_.push_back(std::move(above));
  }
}

AabbTree::Nearest AabbTree::nearest(Point p, std::size_t guess) const {
  Nearest best{to_edge(p, guess), guess};
  inspect_edges(p, guess / kFan, best);
  inspect_box(p, levels_.size() - 1, 0, best);
  return best;
}

void AabbTree::widen(Box& box, const Box& by) {
  box.low = {std::min(box.low.x, by.low.x), std::min(box.low.y, by.low.y)};
  box.high = {std::max(box.high.x, by.high.x), std::max(box.high.y, by.high.y)};
}

void AabbTree::inspect_edges(Point p, std::size_t group, Nearest& best) const {
  const std::size_t end = std::min((group + 1) * kFan, edges_.size());
  for (std::size_t i = group * kFan; i < end; ++i) {
    const double d2 = to_edge(p, i);
    if (d2 < best.d2) best = {d2, i};
  }
}

// Inspects box i of a level and everything in it.
void AabbTree::inspect_box(Point p, std::size_t level, std::size_t i, Nearest& best) const {
  const Box& box = levels_[level][i];
  const double x = std::max({box.low.x - p.x, p.x - box.high.x, 0.0}),
               y = std::max({box.low.y - p.y, p.y - box.high.y, 0.0});
  if (x * x + y * y >= best.d2) return;
  if (level == 0) {
    inspect_edges(p, i, best);
    return;
  }
  const std::size_t end = std::min((i + 1) * kFan, levels_[level - 1].size());
  for (std::size_t k = i * kFan; k < end; ++k)
    inspect_box(p, level - 1, k, best);
}

double outline_distance_mm(std::span<const OutlineRing> a, std::span<const OutlineRing> b,
                           double accuracy_mm) {
  const std::vector<OutlineEdge> of_a = edges_of(a), of_b = edges_of(b);
  if (of_a.empty() || of_b.empty())
    return of_a.empty() && of_b.empty() ? 0 : std::numeric_limits<double>::infinity();
  double worst = 0;
  raise(of_a, AabbTree(of_b), accuracy_mm, worst);
  raise(of_b, AabbTree(of_a), accuracy_mm, worst);
  return worst;
}

// Implements hausdorff_mm() of simplification.h.

double hausdorff_mm(const Pslg& contours, const Pslg& rings, const Lattice& lattice,
                    const std::vector<bool>& is_open) {
  double worst2 = 0;
  for (std::size_t r = 0; r < contours.rings.size(); ++r) {
    const bool open = !is_open.empty() && is_open[r];
    raise_by_ring(contours.rings[r], rings.rings[r], open, worst2);
    raise_by_ring(rings.rings[r], contours.rings[r], open, worst2);
  }
  return std::sqrt(worst2) * lattice.step_mm();
}

double moved_area_mm2(const Pslg& contours, const Pslg& rings, const Lattice& lattice,
                      double beyond_mm, const std::vector<bool>& is_open) {
  const double step_mm = lattice.step_mm(), beyond = beyond_mm / step_mm;
  double sum = 0;  // lattice steps squared
  for (std::size_t r = 0; r < contours.rings.size(); ++r) {
    const bool open = !is_open.empty() && is_open[r];
    const Target to(rings.rings[r], open);
    const Ring& ring = contours.rings[r];
    std::size_t edge = 0;
    for (std::size_t i = 0; i + (open ? 1 : 0) < ring.size(); ++i) {
      const Point a = point(ring[i]), b = point(ring[i + 1 < ring.size() ? i + 1 : 0]);
      const Target::Nearest near = to.nearest({0.5 * (a.x + b.x), 0.5 * (a.y + b.y)}, edge);
      edge = near.edge;
      if (near.d2 > beyond * beyond) sum += std::sqrt(near.d2 * distance2_between(a, b));
    }
  }
  return sum * step_mm * step_mm;
}

}  // namespace trocar::pipeline
