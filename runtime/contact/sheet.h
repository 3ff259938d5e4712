// SPDX-License-Identifier: Apache-2.0
// A sheet: one slice of an asset, placed in the device's frame, with a grid to look up the
// triangles under the tool. The haptic thread only reads it; holes are cut into a replica that is
// not visible to the haptic thread (runtime/workers/remesher.h).
// Tests: tests/runtime/contact/place_slices_test.cpp
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/session/scene.h"
#include "runtime/contact/slice_field.h"
#include "runtime/contact/tool.h"
#include "runtime/sheet_mesh/sheet_mesh.h"
#include "runtime/sheet_mesh/triangle_grid.h"

namespace trocar::runtime {

struct Sheet {
  int slice_index = 0;  ///< AssetSlice::index
  double z_m = 0;       ///< height in {B}
  Tissue tissue;
  PlanarTransform transform;
  SheetMesh mesh;
  TriangleGrid grid;       ///< over `mesh`
  std::uint32_t cuts = 0;  ///< holes in `mesh` that the asset's slice does not have
  std::shared_ptr<const SliceField> field;  ///< force law `cutting`; else null
  /// At each vertex of the mesh without holes, in its order; null: the asset has none.
  std::shared_ptr<const std::vector<float>> hu;
};

/// Replaces the slices of a scene that has a body by those of the asset that it names and that have
/// material, at their true spacing. Refused, with `name` (the asset's): there is none, planes that
/// are not parallel or not apart, heights beyond the device's metre.
Result<void> place_body(Scene& scene, const Asset& asset, const std::string& name);

/// The scene's slices, the topmost first. Checks every mesh (formats/geometry/mesh_validity.h):
/// contact and cut rely on it. Refused, with `name` (the asset's) in the message: a slice that the
/// asset does not have, a slice without material, an invalid mesh, a tool that is too small for the
/// lattice or has more than kMaxToolPieces convex parts.
Result<std::vector<std::unique_ptr<const Sheet>>> place_slices(const Scene& scene,
                                                               const Asset& asset,
                                                               const std::string& name);

/// The plate's pose with the tool upright and its tip on the sheet, over the scene's anchor.
Pose over_anchor(const Sheet& sheet, const Tool& tool) noexcept;

/// Free slots of a placed sheet for what its cuts add; more are added when they run short. A hole
/// of six corners takes about six vertices and twelve triangles.
inline constexpr std::size_t kSpareVertices = 4096, kSpareTriangles = 8192;

/// Holes of one sheet that may wait for their mesh.
inline constexpr int kMaxPendingHoles = 4;

}  // namespace trocar::runtime
