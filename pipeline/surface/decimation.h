// SPDX-License-Identifier: GPL-3.0-or-later
// Decimation of a closed surface by quadrics.
// Tests: tests/pipeline/surface/decimation_test.cpp
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "formats/geometry/triangle_surface.h"

namespace trocar::pipeline {

/// Collapses vertices of a surface into neighbours, in ascending order of error. The error is the
/// sum, over the original triangles around a vertex, of area times squared distance from the
/// triangle's plane (Garland and Heckbert 1997), plus a small multiple of the edge's length. A
/// collapse removes two triangles, keeps the surface closed and manifold, turns no triangle by more
/// than 60 degrees, and creates no triangle that intersects a neighbour. Distant parts of the
/// surface may still intersect. The caller finds such triangles and undoes collapses.
/// Deterministic. Memory: 250 bytes for each vertex.
class Decimation {
 public:
  struct Collapse {
    std::uint32_t from = 0, to = 0;
  };

  /// The surface must pass check_triangle_surface() and outlive this object. If `stop` is set,
  /// collapses end early.
  explicit Decimation(const TriangleSurface& fine, const std::atomic<bool>* stop = nullptr);

  /// Returns the surface with this number of triangles, or with the smallest possible number if
  /// that is larger. The collapses of the last call that were not undone are used again as far as
  /// they are needed, and further ones are added.
  TriangleSurface decimated(std::size_t triangles);

  /// Undoes the last collapses that led to a corner of one of these triangles in the last
  /// result, at most `most` for each corner. Their vertices are kept from now on. Returns false
  /// if there were none.
  bool undo(const std::vector<std::size_t>& triangles, std::size_t most);

 private:
  const TriangleSurface& fine_;
  const std::atomic<bool>* stop_;
  std::vector<Collapse> collapses_;
  std::vector<bool> locked_;
  std::vector<std::array<std::uint32_t, 3>> triangles_;  // of the last result, by fine vertices
};

}  // namespace trocar::pipeline
