// SPDX-License-Identifier: GPL-3.0-or-later
// CGAL verification of an asset: confirms the properties that formats/geometry/mesh_validity.h
// proves with CGAL's exact predicates and its constrained Delaunay triangulation. It shares no code
// with that proof.
#pragma once

#include <string>

#include "formats/asset/asset.h"

namespace trocar::pipeline {

/// Confirms for every slice, or names the slice and the first difference:
///  - Every ring of the outline is a simple polygon, and no two of its edges cross or overlap.
///  - CGAL's triangulation of the outline, with the mesh's vertices, covers the same area with the
///    same number of triangles.
///  - The mesh's triangles are counter-clockwise, meet edge to edge, end only at the outline and
///    use every vertex.
///  - They are CGAL's triangles, or differ from them only where four or more vertices lie on one
///    circle, so that there are several constrained Delaunay triangulations.
/// The outlines of a slice's materials neither cross nor overlap, and every region is assigned to
/// at most one material, consistently from all of its edges. A surface for display has no
/// self-intersection (surface_proof.h); verify_asset() has proved that it is closed and manifold.
/// Coordinates are integers of the lattice, so nothing is rounded. Errors (refused): a property
/// does not hold. O(n log n) for most slices.
Result<void> confirm_by_cgal(const Asset& asset, const std::string& name);

}  // namespace trocar::pipeline
