// SPDX-License-Identifier: GPL-3.0-or-later
// A closed surface by marching cubes, and its decimation.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "formats/base/result.h"
#include "formats/mesh/triangle_surface.h"
#include "pipeline/surface/surface_volume.h"

namespace trocar::pipeline {

// The zero level of a volume as a closed triangle surface, by marching cubes. The surface has no
// gaps between cells: if only two opposite corners of the face between two cells are material, both
// cells connect these corners, or neither does.

/// Makes the surface of the material, in the patient's frame (LPS). The surface is closed, manifold
/// and oriented by construction. At a slice's height it follows the slice's contour. On each edge
/// of the grid that joins a material voxel to an outside voxel, the surface has one vertex. It lies
/// where the linear interpolation is zero, but at least a 16th of the edge away from either end.
/// In a few cells, the polygon of the surface cannot be divided into triangles by its corners
/// alone; it gets a further vertex in its middle. The vertices are in the order of the voxels. The
/// step of their lattice is at most a 64th of a voxel's shortest side, but not below 2^-14 mm.
/// Errors: kRefused if a coordinate exceeds kMaxSpaceCoordinate. O(voxels).
Result<TriangleSurface> isosurface(const SurfaceVolume& volume);

// Decimation: approximates a closed surface by fewer triangles.

/// Reduces the number of triangles of a closed surface. It collapses vertices into neighbours,
/// roughly in ascending order of error. The error of a collapse is a sum over the original
/// triangles around the two vertices: the area of each triangle times the squared distance of the
/// remaining vertex from the triangle's plane (Garland and Heckbert 1997). A small multiple of
/// the fourth power of the edge's length is added, so that short edges come first where the
/// surface is flat. A collapse removes two triangles, keeps the surface closed and manifold,
/// turns no triangle by more than 60 degrees, and creates no triangle that intersects a triangle
/// nearby. Triangles may still intersect, mostly those of distant parts of the surface. The
/// caller must find such triangles and call undo() and decimated() again. Deterministic. Memory:
/// 250 bytes for each vertex.
class Decimation {
 public:
  /// The vertex `from` was merged into the vertex `to`.
  struct Collapse {
    std::uint32_t from = 0, to = 0;
  };

  /// Precondition: the surface has passed check_triangle_surface() and outlives this object. If
  /// `*stop` becomes true, decimated() ends early, with more triangles.
  explicit Decimation(const TriangleSurface& fine, const std::atomic<bool>* stop = nullptr);

  /// Returns the surface with at most this number of triangles, or with more if no further collapse
  /// is allowed. The function first repeats the collapses of the last call that were not undone, as
  /// far as they are needed and still possible. Then it makes further collapses.
  TriangleSurface decimated(std::size_t triangles);

  /// Undoes collapses near some triangles, with effect on the next call of decimated(). `triangles`
  /// has indices into the last result of decimated(). Vertices may have been collapsed into a
  /// corner of these triangles, directly or through further vertices. The function undoes the last
  /// of these collapses, at most `most` for each corner. The vertices that the undone collapses had
  /// merged (Collapse::from) are never collapsed again. Returns false if nothing could be undone.
  bool undo(const std::vector<std::size_t>& triangles, std::size_t most);

 private:
  const TriangleSurface& fine_;
  const std::atomic<bool>* stop_;
  std::vector<Collapse> collapses_;
  std::vector<bool> locked_;  // for each vertex of fine_: true if it must stay
  // The triangles of the last result, with the vertices of fine_.
  std::vector<std::array<std::uint32_t, 3>> triangles_;
};

}  // namespace trocar::pipeline
