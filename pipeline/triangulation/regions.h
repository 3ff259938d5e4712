// SPDX-License-Identifier: GPL-3.0-or-later
// Triangulates and refines several regions (materials of one slice) that share borders, so that
// their meshes leave no gap and do not overlap.
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

/// Refines all regions together, like refine(). If two regions share an edge, the edge is split in
/// both regions at the same lattice point, or in neither. The point may lie on either side of the
/// segment, nearer to it than options.max_distance_steps. Earlier points may have taken area from
/// one of the regions. Where possible, the point lies on the side that gives this area back. So
/// along each border a region's area changes by no more than about the rounding of one point, even
/// without options.keep_area. The regions' outlines and the results of refined_rings() for the
/// regions pass check_shared_borders().
///
/// Each result has the properties stated at refine(). Its members outcome, angle_deg,
/// max_area_mm2 and bad_at_lattice_step describe all regions together. options.max_vertices
/// limits the sum of the vertices of all regions. A split of a shared edge adds two vertices, so
/// the sum may exceed the limit by one. options.shared_borders is ignored. For one region, the
/// result is that of refine().
///
/// Known limitation if options.min_angle_deg is above 30: a border may be divided into edges of
/// only a few lattice steps if it is a few pixels long and joins two points where borders meet at
/// acute angles. This happens more often than with refine() for one region.
std::vector<Refined> refine_regions(std::span<const Triangulation> regions, const Lattice& lattice,
                                    const RefinementOptions& options);

}  // namespace trocar::pipeline
