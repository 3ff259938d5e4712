// SPDX-License-Identifier: Apache-2.0
// The proof, in exact integers, that regions with common borders (the materials of one slice) leave
// no gap and do not overlap.
//
// Two regions share an edge if both outlines have it, in opposite directions. Apart from shared
// edges, outlines of different regions may only touch at vertices.
#pragma once

#include <span>

#include "formats/base/result.h"
#include "formats/geometry/slice_mesh.h"

namespace trocar {

/// `stored[k]` must be `regions[k]`, possibly with further vertices on the edges: it has the same
/// rings in the same order, each with the same first vertex. Precondition: both are valid by
/// check_pslg(). Proves the following, or names the first property that fails and the position:
///  - Two regions that share an edge divide it at the same points. So each segment of the edge
///    occurs once in each direction, and there is no gap.
///  - The edges that are not shared form the outline of the union. It is valid by check_pslg() and
///    therefore winds around every point at most once. So all regions together cover every point at
///    most once, and no two regions overlap.
///  - The areas of the regions sum to the area within the outline of the union.
/// Returns the outline of the union. Each ring begins at its smallest vertex, and the rings are in
/// ascending order. To prove these properties for `regions` itself, pass it twice. Typically O(n
/// log n).
Result<Pslg> check_shared_borders(std::span<const Pslg> regions, std::span<const Pslg> stored);

}  // namespace trocar
