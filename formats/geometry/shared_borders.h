// SPDX-License-Identifier: Apache-2.0
// The proof, in exact integers, that regions with common borders (the materials of one slice) leave
// no gap and do not overlap.
//
// Two regions share an edge if both outlines have it, in opposite directions. Otherwise outlines of
// different regions only touch in vertices.
#pragma once

#include <span>

#include "formats/base/result.h"
#include "formats/geometry/slice_mesh.h"

namespace trocar {

/// `stored[k]` must be `regions[k]` with further vertices on its edges: the same rings in the same
/// order, each with the same first vertex. Both must be valid by check_pslg(). Proves the
/// following, or names the first property that fails and the position:
///  - Both regions divide a shared edge at the same points, so each of its segments occurs once in
///    each direction and nowhere else. So there is no gap.
///  - The other edges form the outline of the union, which is valid by check_pslg() and therefore
///    winds around every point at most once. So all regions together do so too, and no two overlap.
///  - The areas of the regions sum to the area within that outline.
/// Returns the outline of the union. Each ring begins at its smallest vertex, and the rings are in
/// ascending order. To prove the same for the outlines themselves, pass them twice. Typically O(n
/// log n).
Result<Pslg> check_shared_borders(std::span<const Pslg> regions, std::span<const Pslg> stored);

}  // namespace trocar
