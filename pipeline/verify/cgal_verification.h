// SPDX-License-Identifier: GPL-3.0-or-later
// Verifies an asset with the library CGAL. CGAL's exact predicates and its constrained Delaunay
// triangulation confirm the properties that formats/geometry/mesh_validity.h proves. This is an
// independent check, because CGAL and mesh_validity.h share no code.
#pragma once

#include <string>

#include "formats/asset/asset.h"

namespace trocar::pipeline {

/// Confirms the following for every slice:
///  - Every ring of the outline is a simple polygon, and no two edges of the outline cross or
///    overlap.
///  - CGAL's triangulation of the outline, with the mesh's vertices, has the same area and the same
///    number of triangles as the mesh.
///  - The mesh's triangles are counter-clockwise, meet edge to edge and use every vertex. Only an
///    edge of the outline has a triangle on one side alone.
///  - The mesh's triangles are CGAL's triangles, or differ from them only where four or more
///    vertices lie on one circle, so that there are several constrained Delaunay triangulations.
///  - The outlines of the slice's materials neither cross nor overlap. All edges around a region
///    between outlines agree on the region's material, or agree that the region has none.
/// Also confirms that a surface for display does not intersect itself (surface_proof.h).
/// Precondition: verify_asset() has proved that the surface is closed and manifold. Coordinates are
/// integers of the lattice, so nothing is rounded. `name` stands for the file in messages. Errors:
/// kRefused if a property does not hold; the message names the slice or surface and the first such
/// property. O(n log n) for most slices.
Result<void> confirm_by_cgal(const Asset& asset, const std::string& name);

}  // namespace trocar::pipeline
