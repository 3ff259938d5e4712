// SPDX-License-Identifier: GPL-3.0-or-later
// Makes a closed triangle surface of the material for display, in three steps.
//
//  1. The isosurface is computed (isosurface.h). It follows the zero level of the volume, that is,
//     the points at which the values of SurfaceVolume are zero. The vertices lie on an integer
//     lattice, whose step the asset stores.
//  2. The isosurface is decimated to the wanted number of triangles by collapses, each of which
//     merges a vertex into a neighbour (isosurface.h). Where triangles then intersect, the last
//     collapses near them are undone.
//  3. The resulting surface is proved to be closed, manifold and oriented
//     (formats/mesh/triangle_surface.h). CGAL's exact predicates prove that it does not
//     intersect itself. The distances between the surface and the zero level are measured.
#pragma once

#include <algorithm>
#include <atomic>
#include <nlohmann/json.hpp>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/base/result.h"
#include "formats/mesh/triangle_surface.h"
#include "pipeline/segment/solid_bone.h"
#include "pipeline/surface/surface_distance.h"
#include "pipeline/surface/surface_volume.h"

namespace trocar::pipeline {

struct SurfaceOptions {
  int triangles = 50'000;  ///< wanted number of triangles; fewer if the isosurface has fewer
  /// False: the number of triangles is doubled until the distances are within
  /// DisplaySurface::bound_mm. True: the number is not doubled. In both cases the surface gets more
  /// triangles where it would otherwise intersect itself.
  bool at_most = false;
  const std::atomic<bool>* stop = nullptr;  ///< set by a signal handler to stop early
};

struct DisplaySurface {
  TriangleSurface surface;  ///< in the patient's frame (LPS)
  /// Distances from the surface to the zero level of the volume. They include the rounding of the
  /// surface to the lattice.
  SurfaceDistance distance;
  /// Distances from the zero level to the surface. They are large where the surface leaves out
  /// material or a hole.
  SurfaceDistance left_out;
  /// Wanted bound of distance.p99_mm and left_out.p99_mm: half of the mean side of a voxel.
  double bound_mm = 0;
  std::size_t parts = 0;                  ///< number of connected parts, each of them closed
  std::size_t mesher_triangles = 0;       ///< number of triangles of the isosurface
  std::array<int, 3> coarsened{1, 1, 1};  ///< voxels averaged along each axis; 1: no averaging
  double mesher_ms = 0, decimate_ms = 0, check_ms = 0;

  bool is_within_bound() const { return std::max(distance.p99_mm, left_out.p99_mm) <= bound_mm; }
};

/// Makes the surface. If SurfaceOptions::at_most is set and the isosurface has more than 32 times
/// as many triangles as wanted, the isosurface is computed again from averages of voxels
/// (DisplaySurface::coarsened). Deterministic. Errors: kRefused if the surface is outside the range
/// of coordinates. kRefused also if it still intersects itself after all collapses near the
/// intersections have been undone: slices are then too close together for the lattice of its
/// vertices. kUnwritable if SurfaceOptions::stop was set, because nothing is then written. Memory:
/// 350 bytes for each vertex of the isosurface.
Result<DisplaySurface> make_display_surface(const SurfaceVolume& volume,
                                            const SurfaceOptions& options);

// The surfaces for display that an asset stores (--surface).

/// Makes the surface of each material from the slices `first` to `last`, both included. Adds the
/// surfaces to `asset` and warnings about them to `warnings`. Returns the entry `surface` of the
/// report. `materials` has the segmentation of each material of the asset, in the same order; the
/// function uses these segmentations instead of options.segmentation. Errors: those of
/// read_surface_volume() and make_display_surface(); kRefused if the asset has only one material
/// and none of its components is large enough.
Result<nlohmann::json> add_surfaces(const SliceStack& stack, int first, int last,
                                    const MaterialOptions& options, const SurfaceOptions& wanted,
                                    const std::vector<Segmentation>& materials, Asset& asset,
                                    nlohmann::json& warnings);

}  // namespace trocar::pipeline
