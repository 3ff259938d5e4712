// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/contour/aabb_tree.h"

#include <algorithm>
#include <utility>

namespace trocar::pipeline {

AabbTree::AabbTree(std::vector<Edge> edges) : edges_(std::move(edges)) {
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

}  // namespace trocar::pipeline
