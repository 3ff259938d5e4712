// SPDX-License-Identifier: Apache-2.0
// A sheet: one slice of an asset, placed in the device's frame {B}, with a grid to look up the
// triangles under the tool. The haptic thread only reads sheets. Holes are cut into a second copy
// of the sheet that the haptic thread does not use (runtime/workers/remesher.h).
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/session/scene.h"
#include "runtime/contact/edge_distance.h"
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
  TriangleGrid grid;                         ///< grid over the triangles of `mesh`
  TriangleGrid boundary_grid;                ///< grid over the triangles at its boundary
  std::uint32_t cuts = 0;                    ///< number of holes cut into `mesh` during the session
  std::shared_ptr<const SliceField> field;   ///< only with the force law `cutting`; else null
  std::shared_ptr<const EdgeDistance> edge;  ///< only with the force law `cutting`; else null
  /// HU of each vertex of the mesh as loaded, before any hole was cut, in the order of the
  /// vertices; null: the asset has no HU at vertices.
  std::shared_ptr<const std::vector<float>> hu;

  /// Builds both grids for `mesh`.
  void index_mesh();
};

/// If the scene has a `body` (a bone volume made of a range of slices), replaces the scene's slices
/// by the slices of this range that have material, at their true spacing. `name`: the asset's name,
/// which messages contain. Errors: kRefused if fewer than two slices have material, if two
/// neighbouring slices are less than 0.1 mm apart or are not parallel, or if a slice would lie more
/// than 1 m below the device's origin.
Result<void> place_body(Scene& scene, const Asset& asset, const std::string& name);

/// Places the scene's slices and returns the sheets, topmost first. The function checks every mesh
/// (formats/geometry/mesh_validity.h), because contact and cuts rely on valid meshes. `name`: the
/// asset's name, which messages contain. Errors: kRefused if the asset lacks a slice that the scene
/// names, if a slice is empty or has an invalid mesh, if corners of the tool are too close
/// together for the lattice, or if the tool has more than kMaxToolPieces convex parts.
Result<std::vector<std::unique_ptr<const Sheet>>> place_slices(const Scene& scene,
                                                               const Asset& asset,
                                                               const std::string& name);

/// Returns the plate's pose at which the plate is level and the tip is on the sheet, at the point
/// where the scene places the anchor of its slices (Placement::at_m, in {B}).
Pose over_anchor(const Sheet& sheet, const Tool& tool) noexcept;

/// Spare capacity of a placed sheet, for the vertices and triangles that are added when holes are
/// cut. The remesher adds the same numbers when the spare capacity runs short. A hole of six
/// corners needs about six vertices and twelve triangles.
inline constexpr std::size_t kSpareVertices = 4096, kSpareTriangles = 8192;

/// Largest number of holes of one sheet that may wait to be cut into its mesh.
inline constexpr int kMaxPendingHoles = 4;

}  // namespace trocar::runtime
