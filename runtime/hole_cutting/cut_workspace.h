// SPDX-License-Identifier: Apache-2.0
// The scratch memory that a cut needs. It is allocated before the first cut, so that cuts
// need not allocate.
#pragma once

#include <cstddef>

#include "runtime/hole_cutting/cavity.h"
#include "runtime/hole_cutting/delaunay_flips.h"
#include "runtime/hole_cutting/hole_outline.h"
#include "runtime/hole_cutting/overlay.h"
#include "runtime/hole_cutting/patch.h"
#include "runtime/hole_cutting/patch_proof.h"
#include "runtime/hole_cutting/stitch.h"

namespace trocar::runtime {

/// The largest numbers of triangles, points and edges for which the scratch memory of a
/// cut has space.
struct CutCapacity {
  std::size_t triangles = 0;  ///< triangles in a cavity; also triangles that are tested for flips
  std::size_t points = 0;     ///< points of the overlay: vertices, tool corners, bends
  std::size_t edges = 0;      ///< edges of the overlay, including edges that were split
};

/// Returns a capacity that suffices for a sheet with these numbers of slots (sheet_mesh.h), for a
/// tool of any size, and for about 2000 bends. (A bend is the point through which two crossing
/// edges are bent, overlay.h.)
inline CutCapacity capacity_for(std::size_t vertex_slots, std::size_t triangle_slots) noexcept {
  return {triangle_slots, vertex_slots + 2048, triangle_slots + 8192};
}

/// The scratch memory of all stages of a cut. One workspace can serve many sheets, but only
/// one thread at a time. The header of each stage describes what the stage's member contains
/// after a cut.
struct CutWorkspace {
  Cavity cavity;
  Overlay overlay;
  Patch patch;
  HoleOutline hole;
  ProofSpace proof;
  StitchSpace stitch;
  FlipSpace flips;

  CutWorkspace() { allocate({}); }
  explicit CutWorkspace(const CutCapacity& capacity) { allocate(capacity); }

 private:
  void allocate(const CutCapacity& capacity) {
    cavity.allocate(capacity.triangles);
    overlay.allocate(capacity.triangles, capacity.points, capacity.edges);
    patch.allocate(capacity.points);
    hole.allocate(capacity.points, capacity.edges);
    proof.allocate(capacity.edges);
    stitch.allocate(capacity.triangles, capacity.points);
    flips.allocate(capacity.triangles);
  }
};

}  // namespace trocar::runtime
