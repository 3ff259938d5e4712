// SPDX-License-Identifier: Apache-2.0
// Joins regions with common borders (the materials of one slice, shared_borders.h) into one mesh.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "formats/base/result.h"
#include "formats/geometry/slice_mesh.h"

namespace trocar {

struct WeldedRegions {
  SliceMesh mesh;
  /// vertex[r][v] is the index in `mesh` of vertex v of region r.
  std::vector<std::vector<std::uint32_t>> vertex;
};

/// Merges the boundaries of regions. If one region has a boundary edge from point a to point b, and
/// another region has one from b to a, the two edges become one, and so do the vertices at their
/// ends. Vertices that merely have the same position stay separate. Triangles and vertices keep
/// their order, region by region. If each region is valid by check_mesh() and all outlines are
/// valid by check_shared_borders(), the result is valid by check_mesh(), and its boundary is the
/// outline of all regions together. O(n log n).
/// Errors: kRefused if two boundary edges run from a to b, or if a triangle has a vertex that
/// does not exist.
Result<WeldedRegions> weld_regions(std::span<const SliceMesh* const> regions);

}  // namespace trocar
