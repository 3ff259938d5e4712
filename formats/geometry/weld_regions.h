// SPDX-License-Identifier: Apache-2.0
// Regions (materials of one slice) that share borders (shared_borders.h), as one mesh.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "formats/base/result.h"
#include "formats/geometry/slice_mesh.h"

namespace trocar {

struct WeldedRegions {
  SliceMesh mesh;
  /// By region and vertex of it: the mesh's vertex that it became.
  std::vector<std::vector<std::uint32_t>> vertex;
};

/// Where one region has a boundary edge from a to b and another one from b to a, the two edges
/// become one, and so do the vertices at either end. Vertices that merely touch stay apart, as in a
/// pinch. Triangles and vertices keep their order, region by region. Each region is valid by
/// check_mesh(), and the outlines of all by check_shared_borders(); then the result is valid by
/// check_mesh(), and its boundary is the outline of all. Refused: two boundary edges from a to b,
/// and edges of a vertex that is not there. O(n log n).
Result<WeldedRegions> weld_regions(std::span<const SliceMesh* const> regions);

}  // namespace trocar
