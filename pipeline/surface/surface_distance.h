// SPDX-License-Identifier: GPL-3.0-or-later
// Distances between a triangle surface and the zero level of a volume, which is the surface on
// which the volume's interpolated value is 0.
#pragma once

#include <limits>
#include <vector>

#include "formats/mesh/triangle_surface.h"
#include "pipeline/surface/surface_volume.h"

namespace trocar::pipeline {

/// Median, 99th percentile and maximum of distances that were measured at many evenly
/// spread points. They are infinite if nothing was measured, because there are no points or there
/// is no surface.
struct SurfaceDistance {
  static constexpr double kNone = std::numeric_limits<double>::infinity();
  double p50_mm = kNone, p99_mm = kNone, max_mm = kNone;
};

/// Measures the distances from 20,000 points of the surface to the zero level of the volume, whose
/// values are interpolated trilinearly. No measured distance is smaller than the true one. The
/// surface is in the patient's frame.
SurfaceDistance distance_from(const TriangleSurface& surface, const SurfaceVolume& volume);

/// Measures the distances from the points, which are in the volume's frame, to the surface.
SurfaceDistance distance_to(const TriangleSurface& surface, const SurfaceVolume& volume,
                            const std::vector<Eigen::Vector3d>& points);

/// Returns the points at which edges of the grid meet the zero level, in the volume's frame. If
/// there are 40,000 or more, returns 20,000 to 40,000 that are evenly chosen. O(voxels).
std::vector<Eigen::Vector3d> points_on_zero(const SurfaceVolume& volume);

}  // namespace trocar::pipeline
