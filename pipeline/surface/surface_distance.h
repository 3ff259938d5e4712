// SPDX-License-Identifier: GPL-3.0-or-later
// Distances between a triangle surface and the zero level of a volume.
// Tests: tests/pipeline/surface/display_surface_test.cpp
#pragma once

#include <vector>

#include "formats/geometry/triangle_surface.h"
#include "pipeline/surface/surface_volume.h"

namespace trocar::pipeline {

/// Percentiles of distances that were measured at about 20,000 or more evenly spread points.
struct SurfaceDistance {
  double p50_mm = 0, p99_mm = 0, max_mm = 0;
};

/// The distance from the surface, which is in the patient's frame, to the zero level of the
/// trilinear interpolation. The result is never smaller than the true distance.
SurfaceDistance distance_from(const TriangleSurface& surface, const SurfaceVolume& volume);

/// The distance from points in the volume's frame to the surface.
SurfaceDistance distance_to(const TriangleSurface& surface, const SurfaceVolume& volume,
                            const std::vector<Eigen::Vector3d>& points);

/// Points at which edges of the grid meet the zero level: all of them or, if they are many, 20,000
/// to 40,000 that are evenly chosen. O(voxels).
std::vector<Eigen::Vector3d> points_on_zero(const SurfaceVolume& volume);

}  // namespace trocar::pipeline
