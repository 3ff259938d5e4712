// SPDX-License-Identifier: Apache-2.0
// Cuts the hole of a puncture: replaces triangles near the tool so that the mesh covers exactly the
// sheet minus the tool's polygon (paper, Fig. 13).
#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "formats/base/result.h"
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
  kCapacity,  ///< the scratch memory or the sheet's free slots do not suffice
  kBug,       ///< the result could not be proved valid
};
std::string_view to_string(CutOutcome outcome) noexcept;

struct CutReport {
  CutOutcome outcome = CutOutcome::kNoOverlap;
  const char* bug = nullptr;  ///< the violated condition if the outcome is kBug, else null
  /// Twice the removed area in steps^2. It is exactly twice the sheet's area before the cut minus
  /// twice the area after the cut.
  std::int64_t doubled_area_removed = 0;
  std::uint32_t triangles_removed = 0;
  std::uint32_t triangles_created = 0;
  std::uint32_t flips = 0;  ///< number of edges flipped to make all edges Delaunay again
  /// Number of boundary edges of the written triangles that are opposite an angle above 90 degrees.
  /// Their stiffness in the spring network is negative.
  std::uint32_t obtuse_boundary_edges = 0;
};

/// Cuts the polygon `tool` out of `mesh`, in place. Preconditions: `mesh` is valid
/// (check_sheet_mesh()), `grid` indexes its triangles, and `work` and `edit` were made for a sheet
/// with at least as many slots for vertices and triangles (sheet_mesh.h). Contract:
///  1. A triangle is replaced only if the tool overlaps or touches it, or if it is a neighbour of
///     such triangles and rounding requires its replacement. Outside of these triangles, the cut
///     only flips edges that are no longer Delaunay (item 2). All other slots stay as they are,
///     with one exception. The triangles that the cut leaves around a vertex can form several fans,
///     which are connected only in this vertex. Then each fan gets a vertex of its own.
///  2. If all inner edges are locally Delaunay before the cut, all are locally Delaunay after the
///     cut. Vertices under the tool are removed. Other vertices of the replaced triangles stay,
///     unless a bent edge runs through them (item 3).
///  3. Where a tool edge crosses the sheet's boundary, both edges are bent through a lattice point
///     less than sqrt(2) steps away. The point lies on the material's side, so bends do not extend
///     the material. Exception: if the remaining material is thinner than the lattice, a bend may
///     go outwards by the same small distance, and the rings of the hole can cross themselves
///     there. Areas are exact in any case.
///  4. If the tool has no area in common with the sheet, nothing changes.
///  5. With every outcome other than kCut the sheet is unchanged. With kCut the new sheet was
///     proved valid (patch_proof.h) before the first slot was written.
///  6. The function does not allocate. The time depends on the mesh near the tool, not on the size
///     of the sheet.
/// After the cut, `edit` lists the slots written, work.stitch.created lists the new triangles in
/// the cavity, and work.hole contains the rings around the removed material. If the tool lies
/// completely over material, the only ring is the tool's outline. The caller must then update the
/// grid (TriangleGrid::update()).
CutReport cut_in_place(SheetMesh& mesh, const TriangleGrid& grid,
                       std::span<const LatticePoint> tool, CutWorkspace& work,
                       SheetEdit& edit) noexcept;

/// Computes CutReport::obtuse_boundary_edges for the triangles that `edit` lists.
std::uint32_t count_obtuse_boundary_edges(const SheetMesh& mesh, const SheetEdit& edit) noexcept;

struct CutResult : CutReport {
  SliceMesh mesh;  ///< valid (formats/geometry/mesh_validity.h); empty if nothing is left
  /// Rings with the removed material on their left. A ring around a void, or around remaining
  /// material that is enclosed by removed material, is therefore clockwise. Each ring starts at
  /// its smallest vertex, and the rings are in ascending order. The sum of their doubled areas
  /// is exactly doubled_area_removed.
  std::vector<Ring> hole;
};

/// Copies the rings of `hole`.
std::vector<Ring> to_rings(const HoleOutline& hole);

/// Cuts a copy of the sheet, for use where neither time nor memory matters. Precondition: `sheet`
/// is valid (check_mesh()). Errors: kRefused if `tool` is not as CutOutcome::kInvalidTool says, or
/// if make_sheet_mesh() refuses `sheet`; kBug if the result cannot be proved valid.
Result<CutResult> cut(const SliceMesh& sheet, const Ring& tool);

}  // namespace trocar::runtime
