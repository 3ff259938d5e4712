// SPDX-License-Identifier: Apache-2.0
// The hole of a puncture: the mesh of exactly (sheet minus tool polygon), by
// local re-triangulation (paper, Fig. 13).
#pragma once

#include <cstdint>
#include <vector>

#include "formats/result.h"
#include "formats/slice_mesh.h"

namespace trocar::runtime {

struct CutResult {
  SliceMesh mesh;  ///< valid (formats/mesh_validity.h); empty if nothing is left
  /// Twice the removed area in steps^2: area before minus area after, exactly.
  std::int64_t doubled_area_removed = 0;
  /// The outline of the removed material on the lattice, material (the removed
  /// one) on the left; its doubled area is doubled_area_removed. Empty if the tool met nothing.
  std::vector<Ring> hole;
  std::uint32_t triangles_removed = 0;
  std::uint32_t triangles_created = 0;
};

/// Cuts the polygon `tool` (simple, counter-clockwise, on the lattice) out of
/// `sheet`, which must be valid. Only triangles that the tool meets are replaced;
/// the patch is constrained Delaunay. Where a tool edge crosses the sheet's
/// boundary the crossing is rounded to the lattice and both edges pass through
/// the rounded point, so what is removed is exactly `hole`. The tool may meet an
/// edge of the sheet, an older hole, the inside of one triangle, or nothing.
/// Errors: `tool` not simple or not counter-clockwise (refused); a patch that
/// cannot be proved valid (bug; `sheet` is untouched).
Result<CutResult> cut(const SliceMesh& sheet, const Ring& tool);

}  // namespace trocar::runtime
