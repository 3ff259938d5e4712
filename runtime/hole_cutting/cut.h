// SPDX-License-Identifier: Apache-2.0
// Cuts the hole of a puncture into a sheet: replaces triangles near the tool so that the mesh then
// covers the sheet minus the tool's polygon (paper, Fig. 13).
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include "formats/geometry/slice_mesh.h"
#include "runtime/hole_cutting/cut_workspace.h"
#include "runtime/sheet_mesh/sheet_edit.h"
#include "runtime/sheet_mesh/sheet_mesh.h"
#include "runtime/sheet_mesh/triangle_grid.h"

namespace trocar::runtime {

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
  /// edge has a negative stiffness (runtime/deformation/network.h). Only edges of triangles that
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
///     proved valid (patch_proof.h) before the first slot was written.
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

}  // namespace trocar::runtime
