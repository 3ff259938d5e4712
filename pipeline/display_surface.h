// SPDX-License-Identifier: GPL-3.0-or-later
// A closed triangle surface of the material to look at.
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
#include "pipeline/surface_volume.h"

namespace trocar::pipeline {

struct SurfaceOptions {
  int triangles = 50'000;  ///< wanted; where the mesher gives fewer, these
  /// No more, even where DisplaySurface::bound_mm needs more and can be reached.
  bool at_most = false;
  const std::atomic<bool>* stop = nullptr;  ///< set from a signal handler: stop early
};

/// Of 20,000 points spread evenly.
struct SurfaceDistance {
  double p50_mm = 0, p99_mm = 0, max_mm = 0;
};

struct DisplaySurface {
  TriangleSurface surface;  ///< in the patient's frame (LPS)
  /// From the surface to the zero level of the trilinear interpolation; of no point less than its
  /// true distance. It includes the rounding to the lattice.
  SurfaceDistance distance;
  /// From the zero level to the surface: what the surface leaves out.
  SurfaceDistance left_out;
  /// Wanted of distance.p99_mm and left_out.p99_mm: half a voxel, the mean of its sides.
  double bound_mm = 0;
  std::size_t parts = 0;                  ///< closed surfaces that it consists of
  std::size_t mesher_triangles = 0;       ///< before decimation
  std::array<int, 3> coarsened{1, 1, 1};  ///< voxels that were averaged for the mesher
  double mesher_ms = 0, decimate_ms = 0, check_ms = 0;

  bool is_within_bound() const { return std::max(distance.p99_mm, left_out.p99_mm) <= bound_mm; }
};

/// The same volume and options give the same surface. Errors: (refused) the mesher does not end, or
/// finds nothing; the surface is outside the range of coordinates; (unwritable) stopped. For a
/// surface that needs more than about 300,000 points a voxel apart, voxels are averaged first.
Result<DisplaySurface> make_display_surface(const SurfaceVolume& volume,
                                            const SurfaceOptions& options);

}  // namespace trocar::pipeline
