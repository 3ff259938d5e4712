// SPDX-License-Identifier: GPL-3.0-or-later
// A closed triangle surface of the material for display.
//
//  1. CGAL's surface mesher (Boissonnat and Oudot 2005; Rineau and Yvinec) on the zero level of the
//     volume, with bounds on angle, size and distance, beginning with points less than a voxel
//     apart on every part of the surface. All vertices are on the lattice that is stored.
//  2. OpenMesh's decimation by quadrics (Garland and Heckbert 1997) to the wanted number. Where
//     triangles intersect, it is repeated without collapses near them.
//  3. The proof, of what is stored: closed, manifold, oriented (formats/geometry/
//     triangle_surface.h), free of self-intersections by CGAL's exact predicates; its distance.
#pragma once

#include <algorithm>
#include <atomic>

#include "formats/base/result.h"
#include "formats/geometry/triangle_surface.h"
#include "pipeline/surface/surface_volume.h"

namespace trocar::pipeline {

struct SurfaceOptions {
  int triangles = 50'000;  ///< wanted number; fewer if the mesher gives fewer
  /// Whether `triangles` is a limit even if DisplaySurface::bound_mm needs more.
  bool at_most = false;
  const std::atomic<bool>* stop = nullptr;  ///< set by a signal handler to stop early
};

/// Percentiles of the distance of 20,000 evenly spread points.
struct SurfaceDistance {
  double p50_mm = 0, p99_mm = 0, max_mm = 0;
};

struct DisplaySurface {
  TriangleSurface surface;  ///< in the patient's frame (LPS)
  /// The distance from the surface to the zero level of the trilinear interpolation. It is never
  /// underestimated and includes the rounding to the lattice.
  SurfaceDistance distance;
  /// The distance from the zero level to the surface, which shows what the surface leaves out.
  SurfaceDistance left_out;
  /// Wanted bound of distance.p99_mm and left_out.p99_mm: half of the mean side of a voxel.
  double bound_mm = 0;
  std::size_t parts = 0;                  ///< number of closed surfaces
  std::size_t mesher_triangles = 0;       ///< triangles before decimation
  std::array<int, 3> coarsened{1, 1, 1};  ///< voxels averaged for the mesher along each axis
  double mesher_ms = 0, decimate_ms = 0, check_ms = 0;

  bool is_within_bound() const { return std::max(distance.p99_mm, left_out.p99_mm) <= bound_mm; }
};

/// Deterministic. If the surface needs more than about 300,000 points one voxel apart, voxels are
/// averaged first. Errors: (refused) the mesher does not end, or finds nothing; the surface is
/// outside the range of coordinates; (unwritable) stopped.
Result<DisplaySurface> make_display_surface(const SurfaceVolume& volume,
                                            const SurfaceOptions& options);

}  // namespace trocar::pipeline
