// SPDX-License-Identifier: GPL-3.0-or-later
// Triangulation and refinement of several regions (materials of one slice) that share borders, so
// that their meshes leave no gap and do not overlap.
#pragma once

#include <span>
#include <vector>

#include "formats/base/result.h"
#include "formats/geometry/slice_mesh.h"
#include "pipeline/mesh/refinement.h"
#include "pipeline/mesh/triangulation.h"

namespace trocar::pipeline {

/// triangulate() for each region. The outlines, proved by check_shared_borders(regions, regions)
/// (formats/geometry/shared_borders.h), share edges; apart from that they only touch in vertices.
Result<std::vector<Triangulation>> triangulate_regions(std::span<const Pslg> regions);

/// refine() for all regions together: an edge that two of them share is split in both at the same
/// lattice point, or in neither. That point lies less than three steps from the segment on either
/// side, and both regions keep their area along each border but for about one rounding, also
/// without options.keep_area. Each result is as that of refine(); `outcome`, the bounds reached and
/// `bad_at_lattice_step` are those of all together, as is options.max_vertices, which may be
/// exceeded by one. One region gives the same as refine(). Above 30 degrees, borders of a few
/// pixels between acute nodes are divided down to the lattice step more often than by refine()
/// alone. The regions' refined_rings() pass check_shared_borders() with their outlines. The member
/// `shared_borders` of the options does not matter.
std::vector<Refined> refine_regions(std::span<const Triangulation> regions, const Lattice& lattice,
                                    const RefinementOptions& options);

}  // namespace trocar::pipeline
