// SPDX-License-Identifier: Apache-2.0
// Replaces the cavity in the sheet by the patch (the new triangles). This is the sixth stage
// of a cut.
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
  /// A sequence of kept triangles around a vertex on the cavity's boundary. Each triangle shares an
  /// edge with the next, and the sequence is as long as possible.
  struct Run {
    std::uint32_t vertex;
    /// The triangles' corners at the vertex are the elements first to end - 1 of `corners`.
    std::uint32_t first, end;
  };
  /// A vertex to be created. All corners in the group (see `parent`) get this vertex.
  struct NewVertex {
    std::uint32_t group;
    LatticePoint point;
  };
  std::vector<Corner> corners;
  std::vector<Run> runs;
  /// Finds a run. Key: the run's vertex, and a triangle at either end of the run; value: index into
  /// `runs`.
  FlatTable run_at;
  /// Union-find structure. Its elements are the runs, followed by the corners of the patch's
  /// triangles. It joins elements to groups; all elements of a group become one vertex.
  std::vector<std::uint32_t> parent;
  std::vector<std::uint32_t> vertex;  ///< vertex slot of each group; index: the group's root
  FlatTable taken;                    ///< vertices on the cavity's boundary that keep their slots
  std::vector<NewVertex> fresh;
  std::vector<std::uint32_t> created;      ///< result: slots of the patch's triangles in the sheet
  std::vector<TriangleEdge> shared_edges;  ///< result: patch edges shared with kept triangles

  void allocate(std::size_t max_triangles, std::size_t max_points);
};

/// Replaces the cavity's triangles by the patch (the new triangles). A fan is a sequence of
/// triangles around a vertex in which each triangle shares an edge with the next. Kept triangles
/// keep their vertices, with one exception: if the triangles around a vertex form several fans
/// after the cut, each fan but the first gets a new vertex, because a valid mesh has only one fan
/// at a vertex. Vertices that no triangle uses any more are released. If the scratch memory or the
/// sheet's free slots do not suffice, the function returns kCapacity and changes nothing.
StageOutcome stitch(SheetMesh& mesh, const Cavity& cavity, const Overlay& overlay,
                    const Patch& patch, StitchSpace& space, SheetEdit& edit) noexcept;

}  // namespace trocar::runtime
