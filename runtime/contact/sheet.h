// SPDX-License-Identifier: Apache-2.0
// A sheet: one slice of an asset, placed in the device's frame, with the grid that
// makes looking up what lies under the tool cheap. The haptic thread only reads it; holes are cut
// into a replica of it that nobody reads meanwhile (runtime/session/workers.h).
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/session/scene.h"
#include "runtime/contact/tool.h"
#include "runtime/mesh/sheet_mesh.h"
#include "runtime/mesh/triangle_grid.h"

namespace trocar::runtime {

struct Sheet {
  int slice_index = 0;  ///< AssetSlice::index
  double z_m = 0;       ///< height in {B}
  Tissue tissue;
  PlanarTransform transform;
  SheetMesh mesh;
  TriangleGrid grid;       ///< over `mesh`
  std::uint32_t cuts = 0;  ///< holes that `mesh` has more than the asset's slice
};

/// The scene's slices, the topmost first. Proves every mesh (formats/geometry/mesh_validity.h),
/// since all that follows relies on it. Refused, with `name` (the asset's) in the message: a slice
/// the asset does not have, one without material, an invalid mesh, a tool that is too small for the
/// lattice or has more than kMaxToolPieces convex parts.
Result<std::vector<std::unique_ptr<const Sheet>>> place_slices(const Scene& scene,
                                                               const Asset& asset,
                                                               const std::string& name);

/// Free slots that a placed sheet has for what its cuts add, and gets again when they run short: a
/// hole of six corners takes about six vertices and twelve triangles.
inline constexpr std::size_t kSpareVertices = 4096, kSpareTriangles = 8192;

/// Holes that one sheet may have waiting for their mesh.
inline constexpr int kMaxPendingHoles = 4;

}  // namespace trocar::runtime
