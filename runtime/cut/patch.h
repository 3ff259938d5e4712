// SPDX-License-Identifier: Apache-2.0
// Third stage of a cut: the new triangles of the cavity.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "runtime/cut/local_delaunay.h"
#include "runtime/cut/overlay.h"

namespace trocar::runtime {

/// The new triangles; their edges are numbered as in triangle_edge.h.
struct Patch {
  std::vector<Triangle> triangles;                   ///< into Overlay::points
  std::vector<std::array<std::uint32_t, 3>> across;  ///< triangle of the patch beyond, or kNone
  std::vector<std::array<std::uint32_t, 3>> kept;    ///< triangle of the sheet beyond, or kNone
  std::vector<std::uint32_t>
      absorb;  ///< kAgain: the patch covers these triangles, which were to stay

  struct Winding {
    std::int32_t rim, tool;
  };
  LocalTriangulation triangulation;  ///< scratch, like all that follows, by its cells
  std::vector<Winding> windings;
  std::vector<std::uint8_t> part;     ///< 1: material; 0: void; 2: not looked at yet
  std::vector<std::uint32_t> number;  ///< of the patch's triangle
  std::vector<std::uint32_t> pending;

  void allocate(std::size_t max_points);
};

/// Constrained Delaunay triangles of the overlay that lie inside the rim and outside the tool.
/// kAgain: only `absorb` is valid. kBug: the overlay is not a PSLG.
StageOutcome make_patch(const Overlay& overlay, Patch& patch) noexcept;

}  // namespace trocar::runtime
