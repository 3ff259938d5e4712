// SPDX-License-Identifier: Apache-2.0
// Finds the neighbours of each triangle of a mesh.
#pragma once

#include <array>
#include <vector>

#include "formats/base/result.h"
#include "formats/mesh/predicates.h"
#include "formats/mesh/slice_mesh.h"

namespace trocar {

/// Element [t][i] belongs to edge i of triangle t (numbered as in predicates.h). It identifies
/// the same edge in the neighbouring triangle. It is kNoEdge if the edge is on the boundary.
using Neighbours = std::vector<std::array<EdgeId, 3>>;

/// Finds the neighbours in a mesh. Precondition: the mesh is valid. O(n).
Neighbours neighbours(const SliceMesh& mesh);

// Triangulates the material inside an outline. The result is the constrained Delaunay
// triangulation: it contains every edge of the outline, and apart from this its smallest angle is
// as large as possible. Triangles outside the material are never made. (The paper makes them and
// then removes them by a "triangle-eating virus".)

struct Triangulation {
  SliceMesh mesh;
  Neighbours beyond;  ///< the neighbour beyond each edge of each triangle
};

/// Returns the constrained Delaunay triangulation of the material, which is a valid mesh. The
/// mesh's boundary is exactly the PSLG. If rings touch at a point, the triangles around this point
/// form several fans (in a fan, each triangle shares an edge with the next). The mesh then has one
/// vertex at this point for each fan. Precondition: `pslg` is valid by check_pslg(). The time is
/// O(n log n) typically, and O(n^2) at worst, because edges are flipped until they are Delaunay.
/// Errors: kBug if `pslg` is found to be invalid.
///
/// The function computes in exact integers, and first rotates the outline into a canonical
/// orientation (formats/mesh/canonical_rotation.h). So if the outline is moved or rotated by
/// right angles, the mesh moves and rotates with it. The only exception is an outline that has no
/// unique canonical orientation, for example because it is symmetric under a rotation, and that has
/// four points on one circle, so that two Delaunay triangulations are possible.
Result<Triangulation> triangulate(const Pslg& pslg);

}  // namespace trocar
