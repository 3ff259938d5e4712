// SPDX-License-Identifier: Apache-2.0
// Cuts a hole into a copy of a slice's mesh, with a workspace of its own.
#pragma once

#include <string>
#include <vector>

#include "formats/base/result.h"
#include "formats/mesh/cut.h"

namespace trocar::runtime {

struct CutResult : CutReport {
  SliceMesh mesh;  ///< valid (formats/mesh/mesh_validity.h); empty if nothing is left
  /// Rings with the removed material on their left. If removed material encloses a void or
  /// remaining material, the ring around the enclosed region is therefore clockwise. Each ring
  /// starts at its smallest vertex (by x, then y), and the rings are in ascending order. The sum of
  /// their doubled areas is exactly doubled_area_removed.
  std::vector<Ring> hole;
};

/// Returns a copy of the rings of `hole`.
inline std::vector<Ring> to_rings(const HoleOutline& hole) {
  std::vector<Ring> rings;
  for (std::size_t r = 0; r < hole.rings(); ++r) {
    const std::span<const LatticePoint> ring = hole.ring(r);
    rings.emplace_back(ring.begin(), ring.end());
  }
  return rings;
}

/// Cuts a copy of the sheet, for use where neither time nor memory matters. Precondition: `sheet`
/// is valid (check_mesh()). Errors: kRefused if the tool is invalid (CutOutcome::kInvalidTool) or
/// if make_sheet_mesh() refuses `sheet`; kBug if cut_in_place() returns kBug, or returns kCapacity
/// even with more than a million spare slots.
inline Result<CutResult> cut(const SliceMesh& sheet, const Ring& tool) {
  for (std::size_t spare = 64;; spare *= 8) {
    Result<SheetMesh> mesh = make_sheet_mesh(sheet, spare, 2 * spare);
    if (!mesh) return mesh.error();
    const std::size_t slots = mesh->triangles.size();
    CutWorkspace work({slots, mesh->vertices.size() + spare, 3 * slots + spare});
    SheetEdit edit(*mesh);
    CutResult result;
    static_cast<CutReport&>(result) = cut_in_place(*mesh, TriangleGrid(*mesh), tool, work, edit);
    switch (result.outcome) {
      case CutOutcome::kNoOverlap:
        result.mesh = sheet;
        return result;
      case CutOutcome::kCut:
        result.mesh = to_slice_mesh(*mesh);
        result.hole = to_rings(work.hole);
        return result;
      case CutOutcome::kInvalidTool:
        return refused("tool polygon: not simple, counter-clockwise and on the lattice, of 3 to " +
                       std::to_string(kMaxToolCorners) + " corners");
      case CutOutcome::kBug:
        return bug(std::string("cut: ") + result.bug);
      case CutOutcome::kCapacity:
        if (spare > 1'000'000) return bug("cut: no capacity suffices");
    }
  }
}

}  // namespace trocar::runtime
