// SPDX-License-Identifier: Apache-2.0
// The proof, in exact integers, that regions with common borders (the materials of one slice) leave
// no gap and do not overlap.
//
// Two regions share an edge if the outlines of both have the edge, in opposite directions. Apart
// from shared edges, outlines of different regions may only touch at vertices.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "formats/base/result.h"
#include "formats/mesh/slice_mesh.h"

namespace trocar {

/// `regions` are the outlines before refinement, `stored` the outlines of the meshes: stored[k] has
/// the rings of regions[k] in the same order, each with the same first vertex, but may have further
/// vertices on the edges. To check outlines without further vertices, pass them as both arguments.
/// Precondition: all outlines are valid by check_pslg(). The function proves:
///  - Two regions that share an edge divide the edge at the same points. So each segment of the
///    edge occurs once in each direction, and there is no gap.
///  - The edges that are not shared form the outline of the union. This outline is valid by
///    check_pslg() and therefore winds around every point at most once. So all regions together
///    cover every point at most once, and no two regions overlap.
///  - The areas of the regions sum to the area within the outline of the union.
/// Returns the outline of the union. Each of its rings begins at the vertex with the smallest x
/// and, among those, the smallest y. The rings are sorted lexicographically by their vertices.
/// Errors: kRefused if a property fails; the message names the property and, for the first two
/// properties, the position. Typically O(n log n).
Result<Pslg> check_shared_borders(std::span<const Pslg> regions, std::span<const Pslg> stored);

// Joins regions with common borders (the materials of one slice, shared_borders.h) into one mesh.

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
