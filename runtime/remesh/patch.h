// SPDX-License-Identifier: Apache-2.0
// Last stages of a cut: the new triangles of the cavity, joined to those that
// stay, and the outline of what went.
#pragma once

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "formats/result.h"
#include "formats/slice_mesh.h"
#include "runtime/remesh/cavity.h"
#include "runtime/remesh/overlay.h"

namespace trocar::runtime {

/// The new triangles. Side i runs from corner i to corner i + 1 (mod 3).
struct Patch {
  std::vector<LatticePoint> points;
  std::vector<Triangle> triangles;                   ///< into `points`
  std::vector<std::array<std::uint32_t, 3>> across;  ///< triangle of the patch beyond, or kNone
  std::vector<std::array<std::uint32_t, 3>> kept;    ///< triangle of the sheet beyond, or kNone
  std::vector<std::uint32_t> absorb;  ///< not empty: the patch lies over these triangles that
                                      ///< stay; nothing else is valid, repeat with them gone
};

/// Constrained Delaunay triangles of the overlay where the rim winds around the
/// material and the tool does not. Errors (bug): the overlay is not a PSLG.
Result<Patch> make_patch(const Overlay& overlay);

/// The sheet with the cavity's triangles replaced by the patch: the kept
/// triangles in their order, then the patch's; kept vertices in their order, then
/// new ones. A vertex where the cut leaves several fans of triangles is split,
/// one vertex a fan, so the mesh stays manifold.
SliceMesh stitch(const SliceMesh& sheet, const Neighbours& neighbours, const Cavity& cavity,
                 const Patch& patch);

/// Rings around (cavity minus patch), that on their left: exactly what went.
/// Simple rings, which may touch in vertices, each from its smallest vertex on,
/// in ascending order. Errors (bug): rim and patch do not bound anything.
Result<std::vector<Ring>> removed_outline(const SliceMesh& sheet, const Cavity& cavity,
                                          const Patch& patch);

}  // namespace trocar::runtime
