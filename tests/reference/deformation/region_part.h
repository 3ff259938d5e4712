// SPDX-License-Identifier: Apache-2.0
// The triangles near a tool without a grid, and a region mesh cut down to a smaller radius on the
// same triangles.
#pragma once

#include <cstdint>
#include <vector>

#include "runtime/haptics/membrane/region.h"

namespace trocar::runtime {

/// The slots of all triangles whose bounding box intersects the tool's box, ascending; none for an
/// empty tool. Inspects every triangle: O(slots). The programs use triangle_grid.h.
std::vector<std::uint32_t> find_seeds(const SheetMesh& sheet, const Ring& tool);

/// The part of `region` within `radius_m` of the tool's circumscribed circle, connected with the
/// tool, on the same triangles; nodes on the new border are kBorder. Its equilibrium differs from
/// that of `region` by the effect of the ring alone. O(n).
struct RegionPart {
  RegionMesh region;
  std::vector<std::uint32_t> parent;  ///< number of each vertex in the full region
};
RegionPart part_within(const RegionMesh& region, const Ring& tool, const Lattice& lattice,
                       double radius_m);

}  // namespace trocar::runtime
