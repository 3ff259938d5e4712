// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/contour/outline_distance.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

namespace trocar::pipeline {
namespace {

using Edge = std::array<Point, 2>;

std::vector<Edge> edges_of(std::span<const OutlineRing> rings) {
  std::vector<Edge> out;
  for (const OutlineRing& ring : rings) {
    for (std::size_t i = 0; i < ring.size(); ++i)
      out.push_back({ring[i], ring[i + 1 < ring.size() ? i + 1 : 0]});
  }
  return out;
}

// Edges to which distances are measured, in groups of consecutive ones with a box around each.
class Target {
 public:
  explicit Target(std::vector<Edge> edges)
      : edges_(std::move(edges)),
        group_(std::max<std::size_t>(
            4, static_cast<std::size_t>(std::sqrt(static_cast<double>(edges_.size()))))) {
    for (std::size_t i = 0; i < edges_.size(); i += group_) {
      Box box{edges_[i][0], edges_[i][0]};
      for (std::size_t k = i; k < std::min(i + group_, edges_.size()); ++k) {
        for (const Point p : edges_[k]) {
          box.low = {std::min(box.low.x, p.x), std::min(box.low.y, p.y)};
          box.high = {std::max(box.high.x, p.x), std::max(box.high.y, p.y)};
        }
      }
      boxes_.push_back(box);
    }
  }

  struct Nearest {
    double d2 = 0;
    std::size_t edge = 0;
  };
  double to_edge(Point p, std::size_t edge) const {
    return segment_distance2(edges_[edge][0], edges_[edge][1], p);
  }
  // `guess` is looked at first: near the nearest edge, little else is.
  Nearest nearest(Point p, std::size_t guess) const {
    Nearest best{to_edge(p, guess), guess};
    for (std::size_t g = 0; g < boxes_.size(); ++g) {
      const Box& box = boxes_[g];
      const double x = std::max({box.low.x - p.x, p.x - box.high.x, 0.0}),
                   y = std::max({box.low.y - p.y, p.y - box.high.y, 0.0});
      if (x * x + y * y >= best.d2) continue;
      for (std::size_t i = g * group_; i < std::min((g + 1) * group_, edges_.size()); ++i) {
        const double d2 = to_edge(p, i);
        if (d2 < best.d2) best = {d2, i};
      }
    }
    return best;
  }

 private:
  struct Box {
    Point low, high;
  };
  std::vector<Edge> edges_;
  std::size_t group_;
  std::vector<Box> boxes_;
};

struct End {
  Point p;
  Target::Nearest near;
};

// Raises `worst` to the largest distance from the piece between two points to the target, but for
// the accuracy. The distance to one edge is convex along the piece: its largest value is at an end.
// And the distance to all edges changes by no more than the way along the piece.
void raise_by_piece(const Target& to, const End& a, const End& b, double accuracy, double& worst) {
  const double length = std::sqrt(distance2_between(a.p, b.p));
  const double by_a = std::max(a.near.d2, to.to_edge(b.p, a.near.edge)),
               by_b = std::max(b.near.d2, to.to_edge(a.p, b.near.edge));
  const double bound = std::min(std::sqrt(std::min(by_a, by_b)),
                                (std::sqrt(a.near.d2) + std::sqrt(b.near.d2) + length) / 2);
  if (bound <= worst + accuracy) return;
  const Point middle{0.5 * (a.p.x + b.p.x), 0.5 * (a.p.y + b.p.y)};
  const End m{middle, to.nearest(middle, a.near.edge)};
  worst = std::max(worst, std::sqrt(m.near.d2));
  raise_by_piece(to, a, m, accuracy, worst);
  raise_by_piece(to, m, b, accuracy, worst);
}

void raise(const std::vector<Edge>& from, const Target& to, double accuracy, double& worst) {
  std::size_t guess = 0;
  for (const Edge& edge : from) {
    const End a{edge[0], to.nearest(edge[0], guess)};
    const End b{edge[1], to.nearest(edge[1], a.near.edge)};
    worst = std::max({worst, std::sqrt(a.near.d2), std::sqrt(b.near.d2)});
    raise_by_piece(to, a, b, accuracy, worst);
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
  raise(of_a, Target(of_b), accuracy_mm, worst);
  raise(of_b, Target(of_a), accuracy_mm, worst);
  return worst;
}

}  // namespace trocar::pipeline
