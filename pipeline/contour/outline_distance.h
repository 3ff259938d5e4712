// SPDX-License-Identifier: GPL-3.0-or-later
// A tree of axis-aligned bounding boxes, which finds the edge nearest to a point. Each box encloses
// edges with consecutive indices.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "formats/mesh/segment_grid.h"

namespace trocar::pipeline {

using OutlineEdge = std::array<Point, 2>;

class AabbTree {
 public:
  /// Precondition: there is at least one edge. Searches are quick if edges with consecutive indices
  /// are near each other. O(n).
  explicit AabbTree(std::vector<OutlineEdge> edges);

  std::size_t size() const { return edges_.size(); }
  const OutlineEdge& edge(std::size_t i) const { return edges_[i]; }

  /// Squared distance from p to edge i.
  double to_edge(Point p, std::size_t i) const {
    return segment_distance2(edges_[i][0], edges_[i][1], p);
  }

  struct Nearest {
    double d2 = 0;  ///< squared distance
    std::size_t edge = 0;
  };
  /// The edge nearest to p. The search starts at edge `guess`. If `guess` is close to the nearest
  /// edge, few boxes are inspected. O(log n) typically.
  Nearest nearest(Point p, std::size_t guess) const;

 private:
  static constexpr std::size_t kFan = 8;  // a box holds at most this many edges or smaller boxes
  struct Box {
    Point low, high;
  };
  static void widen(Box& box, const Box& by);
  void inspect_edges(Point p, std::size_t group, Nearest& best) const;
  void inspect_box(Point p, std::size_t level, std::size_t i, Nearest& best) const;

  std::vector<OutlineEdge> edges_;
  // A box of level 0 encloses up to kFan consecutive edges; a box of a higher level encloses up to
  // kFan boxes of the level below. The last level has one box.
  std::vector<std::vector<Box>> levels_;
};

// The distance between two outlines that may have different numbers of rings. If ring i of one
// outline belongs to ring i of the other, use hausdorff_mm() of simplification.h instead.

/// A closed polygon in mm with at least one point. The first point is not repeated at the end.
using OutlineRing = std::vector<Point>;

/// The two-sided Hausdorff distance between all edges of a and all edges of b, in mm. The result is
/// at most `accuracy_mm` below the exact distance. Precondition: `accuracy_mm` is positive. The
/// result is 0 if neither outline has a ring, and infinite if only one of them has none.
double outline_distance_mm(std::span<const OutlineRing> a, std::span<const OutlineRing> b,
                           double accuracy_mm = 1e-3);

}  // namespace trocar::pipeline
