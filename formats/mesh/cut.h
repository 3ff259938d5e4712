// SPDX-License-Identifier: Apache-2.0
// A cut: the hole of a puncture in a sheet, its scratch memory, and the last stage, the stitch.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "formats/mesh/cavity.h"
#include "formats/mesh/local_delaunay.h"
#include "formats/mesh/overlay.h"
#include "formats/mesh/patch.h"
#include "formats/mesh/sheet_mesh.h"
#include "formats/mesh/slice_mesh.h"
#include "formats/mesh/triangle_grid.h"

namespace trocar {

// Cuts the hole of a puncture into a sheet: stitches the patch into it and records the edit (SheetEdit).

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

// The scratch memory that a cut needs. It is allocated before the first cut, so that cuts
// need not allocate.

/// The largest numbers of triangles, points and edges for which the scratch memory of a
/// cut has space.
struct CutCapacity {
  std::size_t triangles = 0;  ///< triangles in a cavity; also triangles that are tested for flips
  std::size_t points = 0;     ///< points of the overlay: vertices, tool corners, bends
  std::size_t edges = 0;      ///< edges of the overlay, including edges that were split
};

/// Returns a capacity that suffices for a sheet with these numbers of slots (sheet_mesh.h), for a
/// tool of any size, and for about 2000 bends. (A bend is the point through which two crossing
/// edges are bent, overlay.h.)
inline CutCapacity capacity_for(std::size_t vertex_slots, std::size_t triangle_slots) noexcept {
  return {triangle_slots, vertex_slots + 2048, triangle_slots + 8192};
}

/// The scratch memory of all stages of a cut. One workspace can serve many sheets, but only
/// one thread at a time. The header of each stage describes what the stage's member contains
/// after a cut.
struct CutWorkspace {
  Cavity cavity;
  Overlay overlay;
  Patch patch;
  HoleOutline hole;
  ProofSpace proof;
  StitchSpace stitch;
  FlipSpace flips;

  CutWorkspace() { allocate({}); }
  explicit CutWorkspace(const CutCapacity& capacity) { allocate(capacity); }

 private:
  void allocate(const CutCapacity& capacity) {
    cavity.allocate(capacity.triangles);
    overlay.allocate(capacity.triangles, capacity.points, capacity.edges);
    patch.allocate(capacity.points);
    hole.allocate(capacity.points, capacity.edges);
    proof.allocate(capacity.edges);
    stitch.allocate(capacity.triangles, capacity.points);
    flips.allocate(capacity.triangles);
  }
};

// Cuts the hole of a puncture into a sheet: replaces triangles near the tool so that the mesh then
// covers the sheet minus the tool's polygon (paper, Fig. 13).

enum class CutOutcome : std::uint8_t {
  kCut,        ///< the sheet has the hole
  kNoOverlap,  ///< tool and sheet have no area in common
  /// The tool is not a simple counter-clockwise polygon on the lattice with 3 to kMaxToolCorners
  /// different corners.
  kInvalidTool,
  kCapacity,  ///< too little scratch memory, or too few free slots in the sheet
  kBug,       ///< a step of the cut failed, or the result could not be proved valid
};
std::string_view to_string(CutOutcome outcome) noexcept;

struct CutReport {
  CutOutcome outcome = CutOutcome::kNoOverlap;
  const char* bug = nullptr;  ///< the violated condition if the outcome is kBug, else null
  /// Twice the removed area, in steps^2, which is an integer. It is exactly twice the sheet's area
  /// before the cut minus twice the area after the cut.
  std::int64_t doubled_area_removed = 0;
  std::uint32_t triangles_removed = 0;
  std::uint32_t triangles_created = 0;
  /// Number of flips. A flip replaces the edge between two triangles by the other diagonal of the
  /// quadrangle that they form. Flips make all edges locally Delaunay (contract 2).
  std::uint32_t flips = 0;
  /// Number of boundary edges that lie opposite an angle above 90 degrees. The spring of such an
  /// edge has a negative stiffness (runtime/haptics/membrane/network.h). Only edges of triangles that
  /// the cut has written are counted.
  std::uint32_t obtuse_boundary_edges = 0;
};

/// Cuts the polygon `tool` out of `mesh`, in place. Preconditions: `mesh` is valid (invariants of
/// SheetMesh), `grid` indexes its triangles, and `work` and `edit` were made for a sheet with at
/// least as many slots as `mesh` has. A slot is a place for a vertex or a triangle (sheet_mesh.h).
/// Contract:
///  1. The cut replaces the triangles that the tool overlaps or touches. Where rounding requires
///     it, the cut also replaces triangles near them. In the rest of the sheet the cut changes two
///     things. It flips edges that are no longer locally Delaunay (item 2). And if parts of the
///     remaining sheet are joined only by a vertex, each part gets a vertex of its own, because a
///     valid mesh does not join parts in this way.
///  2. An edge between two triangles is locally Delaunay if the two angles opposite the edge add up
///     to at most 180 degrees. If all inner edges are locally Delaunay before the cut, all inner
///     edges are locally Delaunay after the cut. Vertices under the tool are removed. Other
///     vertices of the replaced triangles stay. Exception: a vertex inside the replaced area does
///     not stay if it lies on an edge that was bent by item 3.
///  3. If a tool edge crosses the sheet's boundary, the crossing need not be a lattice point. Both
///     edges are therefore bent through a lattice point less than sqrt(2) steps from the crossing.
///     The lattice point lies on the material's side, so bends do not extend the material.
///     Exception: if the remaining material is thinner than a lattice step, the lattice point may
///     lie outside the material, and the rings of the hole can cross themselves there.
///     doubled_area_removed is exact in any case.
///  4. If the tool has no area in common with the sheet, nothing changes.
///  5. With every outcome other than kCut the sheet is unchanged. With kCut the new sheet was
///     proved valid (patch.h) before the first slot was written.
///  6. The function allocates memory in two cases only. First, the cut writes to more shared pages
///     than SheetMesh::reserve_pages() has reserved. (A shared page is a block of array elements
///     that a copy of the mesh uses too, paged_array.h.) Second, the cut frees more than
///     SheetMesh::kReservedFree slots. The time depends on the mesh near the tool, not on the size
///     of the sheet.
/// After the cut, `edit` lists the slots written, work.stitch.created lists the slots of the new
/// triangles, and work.hole contains the rings around the removed material. If the tool lies
/// completely over material, the only ring is the tool's outline. After kCut the caller must update
/// the grid (TriangleGrid::update()).
CutReport cut_in_place(SheetMesh& mesh, const TriangleGrid& grid,
                       std::span<const LatticePoint> tool, CutWorkspace& work,
                       SheetEdit& edit) noexcept;

/// Computes CutReport::obtuse_boundary_edges for the triangles that `edit` lists.
std::uint32_t count_obtuse_boundary_edges(const SheetMesh& mesh, const SheetEdit& edit) noexcept;

}  // namespace trocar
