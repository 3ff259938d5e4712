// SPDX-License-Identifier: GPL-3.0-or-later
// Verifies an asset with the library CGAL. CGAL confirms the properties that
// formats/mesh/mesh_validity.h proves. CGAL computes its own triangulation, and its tests of
// points and edges have no rounding errors. The check is independent, because CGAL and
// mesh_validity.h share no code.
#pragma once

#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/base/result.h"
#include "formats/mesh/triangle_surface.h"

namespace trocar::pipeline {

/// Confirms the following for every slice:
///  - Every ring of the outline is a simple polygon, and no two edges of the outline cross or
///    overlap.
///  - CGAL makes its own triangulation of the outline with the mesh's vertices. This triangulation
///    has the same area and the same number of triangles as the mesh.
///  - The mesh's triangles are counter-clockwise, meet edge to edge and use every vertex. Only an
///    edge of the outline has a triangle on one side alone.
///  - The mesh's triangles are CGAL's triangles, or differ from them only where four or more
///    vertices lie on one circle, so that there are several constrained Delaunay triangulations.
///  - The outlines of the slice's materials neither cross nor overlap. Each region between outlines
///    has one material or none: all edges around the region agree on this.
/// Also confirms that a surface for display does not intersect itself.
/// Precondition: verify_asset() has proved that the surface is closed and manifold (each edge has
/// exactly two triangles). Coordinates are integers of the lattice, so nothing is rounded. `name`
/// is the file's name in messages. Errors: kRefused if a property does not hold; the message names
/// the slice or surface and the first such property. The time is O(n log n) for most slices
/// with n vertices.
Result<void> confirm_by_cgal(const Asset& asset, const std::string& name);

// Finds the triangles of a surface that intersect each other, with the library CGAL.

/// The indices of the triangles that intersect another triangle in more than a common vertex or
/// edge, in ascending order without repetition. The list is empty if the surface has no
/// self-intersection. Coordinates are integers, so nothing is rounded. Precondition: the triangles
/// refer only to vertices that exist. Errors: kRefused if the triangles do not fit together as a
/// manifold, because CGAL then cannot test all of them; check_triangle_surface() tells why. The
/// time is O(n log n) for most surfaces with n triangles.
Result<std::vector<std::size_t>> self_intersecting_triangles(const TriangleSurface& surface);

}  // namespace trocar::pipeline
