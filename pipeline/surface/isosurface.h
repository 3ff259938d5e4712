// SPDX-License-Identifier: GPL-3.0-or-later
// The zero level of a volume as a closed triangle surface, by marching cubes. The surface has no
// gaps between cells: if only two opposite corners of the face between two cells are material, both
// cells connect these corners, or neither does.
#pragma once

#include "formats/base/result.h"
#include "formats/geometry/triangle_surface.h"
#include "pipeline/surface/surface_volume.h"

namespace trocar::pipeline {

/// Makes the surface of the material, in the patient's frame (LPS). The surface is closed, manifold
/// and oriented by construction. At a slice's height it follows the slice's contour. On each edge
/// of the grid that joins a material voxel to an outside voxel, the surface has one vertex. It lies
/// where the linear interpolation is zero, but at least a 16th of the edge away from either end.
/// In a few cells, the polygon of the surface cannot be divided into triangles by its corners
/// alone; it gets a further vertex in its middle. The vertices are in the order of the voxels. The
/// step of their lattice is at most a 64th of a voxel's shortest side, but not below 2^-14 mm.
/// Errors: kRefused if a coordinate exceeds kMaxSpaceCoordinate. O(voxels).
Result<TriangleSurface> isosurface(const SurfaceVolume& volume);

}  // namespace trocar::pipeline
