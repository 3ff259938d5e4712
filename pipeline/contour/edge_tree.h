// SPDX-License-Identifier: GPL-3.0-or-later
// The nearest of many edges, by a tree of boxes around consecutive ones.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "pipeline/contour/segment_distance.h"

namespace trocar::pipeline {

using Edge = std::array<Point, 2>;

class EdgeTree {
 public:
  /// At least one edge; quick if those that follow each other are near each other. O(n).
  explicit EdgeTree(std::vector<Edge> edges);

  std::size_t size() const { return edges_.size(); }
  const Edge& edge(std::size_t i) const { return edges_[i]; }

  /// Squared distance.
  double to_edge(Point p, std::size_t i) const {
    return segment_distance2(edges_[i][0], edges_[i][1], p);
  }

  struct Nearest {
    double d2 = 0;  ///< squared distance
    std::size_t edge = 0;
  };
  /// `guess` is looked at first: near the nearest edge, little else is. O(log n) typically.
  Nearest nearest(Point p, std::size_t guess) const;

 private:
  static constexpr std::size_t kFan = 8;
  struct Box {
    Point low, high;
  };
  static void widen(Box& box, const Box& by);
  void look_at_edges(Point p, std::size_t group, Nearest& best) const;
  void look_at(Point p, std::size_t level, std::size_t i, Nearest& best) const;

  std::vector<Edge> edges_;
  // Each box is around kFan consecutive edges, or boxes of the level below; the last level has one.
  std::vector<std::vector<Box>> levels_;
};

}  // namespace trocar::pipeline
