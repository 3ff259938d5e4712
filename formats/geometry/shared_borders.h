// SPDX-License-Identifier: Apache-2.0
// Regions (materials of one slice) that share borders: the proof that they leave no gap and do not
// overlap, in exact integers.
//
// Two regions share an edge if both outlines have it, in opposite directions. Apart from that,
// outlines of different regions only touch in vertices.
#pragma once

#include <span>

#include "formats/base/result.h"
#include "formats/geometry/slice_mesh.h"

namespace trocar {

/// `stored[k]` is `regions[k]` with more vertices on its edges: ring by ring in the same order,
/// each from the same first vertex. Both are valid by check_pslg(). Proves the following, or names
/// the first property that fails and where:
///  - every edge that two regions share is divided at the same points in both, so each of its parts
///    occurs once in each direction, and none elsewhere: there is no gap;
///  - the other edges are the outline of the union, which is valid by check_pslg(): it winds around
///    every point at most once, and so do all regions together: none overlap;
///  - the areas of the regions sum to the area within that outline.
/// Returns that outline, each ring from its smallest vertex, in ascending order.
/// To prove the same of outlines themselves, give them twice. O(n log n) typically.
Result<Pslg> check_shared_borders(std::span<const Pslg> regions, std::span<const Pslg> stored);

}  // namespace trocar
