// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/contour/outline_distance.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "pipeline/contour/aabb_tree.h"

namespace trocar::pipeline {
namespace {

std::vector<Edge> edges_of(std::span<const OutlineRing> rings) {
  std::vector<Edge> out;
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

void raise(const std::vector<Edge>& from, const AabbTree& to, double accuracy, double& worst) {
  std::size_t guess = 0;
  for (const Edge& edge : from) {
    const MeasuredEnd a{edge[0], to.nearest(edge[0], guess)};
    const MeasuredEnd b{edge[1], to.nearest(edge[1], a.near.edge)};
    worst = std::max({worst, std::sqrt(a.near.d2), std::sqrt(b.near.d2)});
    raise_by_segment(to, a, b, accuracy, worst);
    guess = b.near.edge;
  }
}

}  // namespace

double outline_distance_mm(std::span<const OutlineRing> a, std::span<const OutlineRing> b,
                           double accuracy_mm) {
  const std::vector<Edge> of_a = edges_of(a), of_b = edges_of(b);
  if (of_a.empty() || of_b.empty())
    return of_a.empty() && of_b.empty() ? 0 : std::numeric_limits<double>::infinity();
  double worst = 0;
  raise(of_a, AabbTree(of_b), accuracy_mm, worst);
  raise(of_b, AabbTree(of_a), accuracy_mm, worst);
  return worst;
}

}  // namespace trocar::pipeline
