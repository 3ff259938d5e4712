// SPDX-License-Identifier: Apache-2.0
// Sixth stage of a cut: replaces the cavity by the patch in the sheet.
#pragma once

#include <cstdint>
#include <vector>

#include "runtime/cut/patch.h"
#include "runtime/mesh/sheet_edit.h"

namespace trocar::runtime {

struct StitchSpace {
  /// A corner of a triangle of the sheet.
  struct Corner {
    std::uint32_t triangle, corner;
  };
  /// Kept triangles that follow each other around a vertex of the cavity's rim.
  struct Run {
    std::uint32_t vertex;
    std::uint32_t first, end;  ///< of its corners
  };
  /// A new vertex, for a group of corners.
  struct NewVertex {
    std::uint32_t group;
    LatticePoint point;
  };
  std::vector<Corner> corners;
  std::vector<Run> runs;
  FlatTable run_at;                   ///< by triangle and vertex
  std::vector<std::uint32_t> parent;  ///< of the groups: runs first, then the patch's corners
  std::vector<std::uint32_t> vertex;  ///< by group
  FlatTable taken;                    ///< vertices of the rim that keep their slot
  std::vector<NewVertex> fresh;
  std::vector<std::uint32_t> created;   ///< result: the patch's triangles, as slots of the sheet
  std::vector<TriangleEdge> rim_edges;  ///< result: their edges towards triangles that stayed

  void allocate(std::size_t max_triangles, std::size_t max_points);
};

/// Replaces the cavity's triangles by the patch. The vertices of triangles that stay keep their
/// slots, except where the cut leaves several fans of triangles at one: then each but the first
/// gets a new slot, so that the mesh stays manifold. Vertices without a triangle are released.
/// kCapacity: the workspace, or the sheet's free slots, do not suffice; nothing has been done.
StageOutcome stitch(SheetMesh& mesh, const Cavity& cavity, const Overlay& overlay,
                    const Patch& patch, StitchSpace& space, SheetEdit& edit) noexcept;

}  // namespace trocar::runtime
