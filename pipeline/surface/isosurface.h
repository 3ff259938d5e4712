// SPDX-License-Identifier: GPL-3.0-or-later
// The zero level of a volume as a closed triangle surface, by marching cubes whose cells agree on
// the topology of ambiguous faces.
// Tests: tests/pipeline/surface/isosurface_test.cpp
#pragma once

#include "formats/base/result.h"
#include "formats/geometry/triangle_surface.h"
#include "pipeline/surface/surface_volume.h"

namespace trocar::pipeline {

/// The surface of the material, in the patient's frame (LPS), on a lattice with a step of at most a
/// 64th of a voxel's shortest side, if it has 14 bits or fewer. It has a vertex on each edge of the
/// grid between material and outside, at the linear interpolation of zero, but at least a 16th of
/// the edge away from its ends; and a vertex in the middle of a few ambiguous cells. Closed,
/// manifold and oriented by construction. At a slice's height it follows the slice's contour.
/// The vertices' order is that of the voxels. Errors: (refused) a coordinate exceeds
/// kMaxSpaceCoordinate. O(voxels).
Result<TriangleSurface> isosurface(const SurfaceVolume& volume);

}  // namespace trocar::pipeline
