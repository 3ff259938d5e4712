// SPDX-License-Identifier: Apache-2.0
// All memory that a cut needs, allocated once.
#pragma once

#include <cstddef>

#include "runtime/cut/cavity.h"
#include "runtime/cut/delaunay_flips.h"
#include "runtime/cut/hole_outline.h"
#include "runtime/cut/overlay.h"
#include "runtime/cut/patch.h"
#include "runtime/cut/patch_proof.h"
#include "runtime/cut/stitch.h"

namespace trocar::runtime {

struct CutCapacity {
  std::size_t triangles = 0;  ///< of a cavity, and of the triangles that flips reach
  std::size_t points = 0;     ///< of the local PSLG: vertices of the cavity, the tool's, bends
  std::size_t edges = 0;      ///< of the local PSLG: rim, tool, and the pieces of both
};

/// Enough for a tool of any size over the sheet, with thousands of bends.
inline CutCapacity capacity_for(std::size_t vertex_slots, std::size_t triangle_slots) noexcept {
  return {triangle_slots, vertex_slots + 2048, triangle_slots + 8192};
}
inline CutCapacity capacity_for(const SheetMesh& mesh) noexcept {
  return capacity_for(mesh.vertices.size(), mesh.triangles.size());
}

/// One for each thread that cuts, for sheets of any size that its capacities allow. Its content
/// after a cut is described with the stages.
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
