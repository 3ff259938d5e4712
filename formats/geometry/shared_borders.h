// SPDX-License-Identifier: Apache-2.0
// The proof, in exact integers, that regions with common borders (the materials of one slice) leave
// no gap and do not overlap.
//
// Two regions share an edge if the outlines of both have the edge, in opposite directions. Apart
// from shared edges, outlines of different regions may only touch at vertices.
#pragma once

#include <span>

#include "formats/base/result.h"
#include "formats/geometry/slice_mesh.h"

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

}  // namespace trocar
