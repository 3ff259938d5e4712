// SPDX-License-Identifier: GPL-3.0-or-later
// CGAL verification of an asset. CGAL's exact predicates and its constrained Delaunay triangulation
// confirm the properties that formats/geometry/mesh_validity.h proves. CGAL and mesh_validity.h
// share no code.
#pragma once

#include <string>

#include "formats/asset/asset.h"

namespace trocar::pipeline {

/// Confirms the following for every slice:
///  - Every ring of the outline is a simple polygon, and no two edges of the outline cross or
///    overlap.
///  - CGAL's triangulation of the outline, with the mesh's vertices, covers the same area with the
///    same number of triangles.
///  - The mesh's triangles are counter-clockwise, meet edge to edge, end only at the outline and
///    use every vertex.
///  - The mesh's triangles are CGAL's triangles, or differ from them only where four or more
///    vertices lie on one circle, so that there are several constrained Delaunay triangulations.
///  - The outlines of the slice's materials neither cross nor overlap. Every region between
///    outlines belongs to at most one material, consistently for all edges around it.
/// Also confirms that a surface for display does not intersect itself (surface_proof.h).
/// Precondition: verify_asset() has proved that the surface is closed and manifold. Coordinates are
/// integers of the lattice, so nothing is rounded. Errors: kRefused; the message names the slice
/// and the first property that does not hold. O(n log n) for most slices.
Result<void> confirm_by_cgal(const Asset& asset, const std::string& name);

}  // namespace trocar::pipeline
