// SPDX-License-Identifier: GPL-3.0-or-later
// Triangulation and refinement of several regions (materials of one slice) that share borders, so
// that their meshes leave no gap and do not overlap.
#pragma once

#include <span>
#include <vector>

#include "formats/base/result.h"
#include "formats/geometry/slice_mesh.h"
#include "pipeline/triangulation/refinement.h"
#include "pipeline/triangulation/triangulation.h"

namespace trocar::pipeline {

/// Calls triangulate() for each region. The outlines must be proved by
/// check_shared_borders(regions, regions) (formats/geometry/shared_borders.h). They may share
/// edges; otherwise they only touch at vertices.
Result<std::vector<Triangulation>> triangulate_regions(std::span<const Pslg> regions);

/// Refines all regions together, like refine(). An edge that two regions share is split in both at
/// the same lattice point, or in neither. That point lies less than three steps from the segment,
/// on either side, and both regions keep their area along each border except for about one
/// rounding, even without options.keep_area. Each result has the properties stated at refine().
/// `outcome`, the bounds that were used and `bad_at_lattice_step` are those of all regions
/// together. options.max_vertices also limits the vertices of all regions together, which may
/// exceed it by one. One region gives the same result as refine(). Above 30 degrees, borders of a
/// few pixels between acute nodes are divided down to the lattice step more often than by refine()
/// alone. The regions' refined_rings() pass check_shared_borders() with their outlines.
/// options.shared_borders is ignored.
std::vector<Refined> refine_regions(std::span<const Triangulation> regions, const Lattice& lattice,
                                    const RefinementOptions& options);

}  // namespace trocar::pipeline
