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
  /// Rings around the removed material, that on their left (so clockwise around
  /// what was void or stays inside it), each from its smallest vertex on, in
  /// ascending order. Their doubled areas add up to doubled_area_removed, exactly.
  /// The tool itself where it lies wholly over material; empty if it met nothing.
  std::vector<Ring> hole;
  std::uint32_t triangles_removed = 0;
  std::uint32_t triangles_created = 0;  ///< the last ones of `mesh`
};

/// Cuts the polygon `tool` (simple, no vertex twice, counter-clockwise, on the
/// lattice) out of `sheet`, which must be valid (check_mesh). Laws:
///  1. Only triangles that the tool meets or touches are replaced, and where
///     rounding asks for it their neighbours. The others stay as they are, in their
///     order, before the new ones; their vertices are renumbered, and a vertex at
///     which the cut leaves several fans of triangles becomes one for each fan.
///  2. The new triangles are constrained Delaunay. Vertices under the tool go;
///     others within the cavity stay.
///  3. Where a tool edge crosses the sheet's boundary, both are bent through a
///     lattice point less than sqrt(2) steps away on the material's side: bends add
///     no material. (Only where what is left would be thinner than the lattice can
///     hold may a bend go out, by as little; the hole's rings can then cross
///     themselves there. The areas stay exact.)
///  4. A tool that has no area in common with the sheet changes nothing.
/// Complexity: O(n log n) for n triangles of the sheet, most of it in finding
/// neighbours and in proving the result; the geometry itself depends only on the
/// cavity. Errors: `tool` not as described, or an index of `sheet` out of range
/// (refused); a result that cannot be proved valid (bug). `sheet` is never changed.
Result<CutResult> cut(const SliceMesh& sheet, const Ring& tool);

}  // namespace trocar::runtime
