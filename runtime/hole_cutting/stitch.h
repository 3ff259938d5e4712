// SPDX-License-Identifier: Apache-2.0
// Sixth stage of a cut: replaces the cavity by the patch in the sheet.
// Tests: tests/runtime/hole_cutting/cut_test.cpp
#pragma once

#include <cstdint>
#include <vector>

#include "runtime/hole_cutting/patch.h"
#include "runtime/sheet_mesh/sheet_edit.h"

namespace trocar::runtime {

struct StitchSpace {
  /// One corner of a triangle of the sheet.
  struct Corner {
    std::uint32_t triangle, corner;
  };
  /// Kept triangles that follow one after the other around a vertex of the cavity's rim.
  struct Run {
    std::uint32_t vertex;
    std::uint32_t first, end;  ///< range of its corners in `corners`
  };
  /// A new vertex for a group of corners.
  struct NewVertex {
    std::uint32_t group;
    LatticePoint point;
  };
  std::vector<Corner> corners;
  std::vector<Run> runs;
  FlatTable run_at;                   ///< index of the run, for a triangle at a vertex
  std::vector<std::uint32_t> parent;  ///< disjoint sets of runs and, after them, patch corners
  std::vector<std::uint32_t> vertex;  ///< vertex of each group
  FlatTable taken;                    ///< vertices of the rim that keep their slots
  std::vector<NewVertex> fresh;
  std::vector<std::uint32_t> created;   ///< result: the patch's triangles, as slots of the sheet
  std::vector<TriangleEdge> rim_edges;  ///< result: patch edges shared with kept triangles

  void allocate(std::size_t max_triangles, std::size_t max_points);
};

/// Replaces the cavity's triangles by the patch. The vertices of kept triangles keep their
/// slots, with one exception. If the cut leaves several fans of triangles at a vertex, each fan
/// but the first gets a new vertex, so that the mesh stays manifold. Vertices without a triangle
/// are released. If the workspace or the sheet's free slots do not suffice, returns kCapacity
/// and changes nothing.
StageOutcome stitch(SheetMesh& mesh, const Cavity& cavity, const Overlay& overlay,
                    const Patch& patch, StitchSpace& space, SheetEdit& edit) noexcept;

}  // namespace trocar::runtime
