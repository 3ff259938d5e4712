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

/// Calls triangulate() for each region. The outlines may share edges; apart from these, they touch
/// only at vertices. Precondition: check_shared_borders(regions, regions) of
/// formats/geometry/shared_borders.h has succeeded. Errors: those of triangulate().
Result<std::vector<Triangulation>> triangulate_regions(std::span<const Pslg> regions);

/// Refines all regions together, like refine(). An edge that two regions share is split in both at
/// the same lattice point, or in neither. That point lies less than three steps from the segment,
/// on either side. Both regions keep their area along each border, even without options.keep_area.
/// Only the rounding of about one point remains as an error. The results of refined_rings() for the
/// regions pass check_shared_borders() with the regions' outlines.
///
/// Each result has the properties stated at refine(). `outcome`, the bounds that were used
/// and `bad_at_lattice_step` are those of all regions together. options.max_vertices limits
/// the sum of the vertices of all regions. A split of a shared edge adds two vertices, so
/// the sum may exceed the limit by one. options.shared_borders is ignored. One region gives
/// the same result as refine().
///
/// Known limitation: for a wanted angle above 30 degrees, a border of a few pixels between acute
/// nodes (points where borders meet) is divided down to the lattice step more often than by
/// refine() for one region.
std::vector<Refined> refine_regions(std::span<const Triangulation> regions, const Lattice& lattice,
                                    const RefinementOptions& options);

}  // namespace trocar::pipeline
