// SPDX-License-Identifier: Apache-2.0
// Makes the patch, which consists of the new triangles that replace the cavity. This is the third
// stage of a cut.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "runtime/hole_cutting/local_delaunay.h"
#include "runtime/hole_cutting/overlay.h"

namespace trocar::runtime {

/// The new triangles; their edges are numbered as in triangle_edge.h.
struct Patch {
  std::vector<Triangle> triangles;  ///< corners are indices into Overlay::points
  /// Triangle of the patch beyond each edge; kNoSlot: there is none.
  std::vector<std::array<std::uint32_t, 3>> across;
  /// Kept triangle of the sheet (a triangle outside the cavity) beyond each edge; kNoSlot:
  /// there is none.
  std::vector<std::array<std::uint32_t, 3>> kept;
  /// If make_patch() returns kAgain: kept triangles that the caller must add to the cavity.
  std::vector<std::uint32_t> absorb;

  /// How many times the boundary of the cavity and the tool's outline wind around a
  /// cell, counted counter-clockwise.
  struct Winding {
    std::int32_t cavity, tool;
  };
  /// Scratch: a triangulation of a box around all points of the overlay. Its triangles
  /// are called cells.
  LocalTriangulation triangulation;
  // The next three members have one entry per cell.
  std::vector<Winding> windings;       ///< winding numbers of the cavity's boundary and of the tool
  std::vector<std::uint8_t> region;    ///< 1: in the patch; 0: not in the patch; 2: undecided yet
  std::vector<std::uint32_t> number;   ///< index in `triangles`; kNoSlot: not in the patch
  std::vector<std::uint32_t> pending;  ///< cells whose neighbours must still be visited

  void allocate(std::size_t max_points);
};

/// Triangulates that part of the overlay which lies inside the cavity and outside the tool. The
/// result is constrained Delaunay (local_delaunay.h). If the function returns kAgain, only
/// `absorb` is valid. kBug means that the overlay is not a PSLG: an edge crosses another one or
/// runs through a point.
StageOutcome make_patch(const Overlay& overlay, Patch& patch) noexcept;

}  // namespace trocar::runtime
