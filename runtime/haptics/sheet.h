// SPDX-License-Identifier: Apache-2.0
// A sheet, the distance to its edge, and the coverage of the tool on it.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/mesh/lattice.h"
#include "formats/mesh/sheet_mesh.h"
#include "formats/mesh/slice_mesh.h"
#include "formats/mesh/triangle_grid.h"
#include "formats/session/scene.h"
#include "runtime/haptics/slice_field.h"
#include "runtime/haptics/tool.h"

namespace trocar::runtime {

// The signed distance of a point to the edge of the material of an uncut slice, and the gradient of
// this distance. Both come from a raster that the haptic thread reads in constant time. Holes cut
// during the session do not change the raster.
//
// Contract:
//  1. At the nodes of the raster the distance is exact except for rounding. Distances are limited
//     to the range from -kReach_mm to kReach_mm. Between the nodes the distance is interpolated
//     bilinearly, which is exact near a straight edge.
//  2. The distance is positive inside the material and negative outside the material. Outside the
//     raster it is -kReach_mm.

class EdgeDistance {
 public:
  /// Distance between neighbouring nodes. If a raster with this distance would have more than about
  /// kMaxNodes nodes, the distance is larger.
  static constexpr double kSpacing_mm = 0.5;
  static constexpr double kMaxNodes = 250'000;
  static constexpr double kReach_mm = 4;

  EdgeDistance() = default;
  /// `outline`: the rings of a slice, with the material on their left. The constructor visits every
  /// node of the raster. For each edge of the outline, it also visits every node within kReach_mm
  /// of the edge's bounding box.
  EdgeDistance(const Pslg& outline, const Lattice& lattice);

  /// Bound on the amount by which at() can overstate a positive distance: the diagonal of a raster
  /// cell. (at() takes a mean of the distances at the four nodes of the point's cell. Each of these
  /// exceeds the true distance at the point by at most the length from the node to the point.)
  double max_error_m() const noexcept { return 1e-3 * 1.4143 * spacing_mm_; }

  struct Sample {
    double distance_m = -1e-3 * kReach_mm;
    Eigen::Vector2d gradient = Eigen::Vector2d::Zero();  ///< gradient of the distance, in {B}
  };
  /// Returns the distance and its gradient at the point with the coordinates x and y in {B}, the
  /// frame of the device (ARCHITECTURE.md). `transform` maps between {B} and the slice plane. No
  /// allocation.
  Sample at(const PlanarTransform& transform, const Eigen::Vector2d& at_m) const noexcept;

 private:
  double left_mm_ = 0, bottom_mm_ = 0, spacing_mm_ = kSpacing_mm;
  int columns_ = 0, rows_ = 0;
  std::vector<float> distance_mm_;  ///< distance at each node, row by row
};

// A sheet: one slice of an asset, placed in the device's frame {B}, with a grid to look up the
// triangles under the tool. The haptic thread only reads sheets. Holes are cut into a second copy
// of the sheet that the haptic thread does not use (runtime/session/remesher.h).

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

/// Returns the slice indices of the scene's slices and of its `body`.
std::vector<int> used_slices(const Scene& scene);

/// If the scene has a `body` (a bone volume made of a range of slices), replaces the scene's slices
/// by the slices of this range that have material, at their true spacing. `name`: the asset's name,
/// which messages contain. Errors: kRefused if fewer than two slices have material, if two
/// neighbouring slices are less than 0.1 mm apart or are not parallel, or if a slice would lie more
/// than 1 m below the device's origin.
Result<void> place_body(Scene& scene, const Asset& asset, const std::string& name);

/// Places the scene's slices and returns the sheets, topmost first. The function checks every mesh
/// (formats/mesh/mesh_validity.h), because contact and cuts rely on valid meshes. `name`: the
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

// The coverage of the tool, which is the fraction of the area of its outline that lies over material, and
// the centroid of the covered area.

struct Overlap {
  double coverage = 0;  ///< fraction of the outline's area that lies over material, in [0, 1]
  /// Centroid of the covered area, in lattice steps. If the coverage is 0 or 1, this is the
  /// centroid of the whole outline.
  Eigen::Vector2d centroid_steps = Eigen::Vector2d::Zero();
};

/// Intersects the tool's outline with the sheet's material, without the material in `holes`. The
/// holes are outlines of the same tool that are not yet cut into the mesh, at most
/// kMaxPendingHoles. A coverage within 1e-9 of 0 or 1 is set to exactly 0 or 1. An empty outline
/// has coverage 0. The function does not allocate. Its time is proportional to the number of
/// triangles near the tool.
Overlap overlap(const Sheet& sheet, const Tool& tool, const LatticeOutline& outline,
                std::span<const LatticeOutline> holes) noexcept;

/// Returns the fraction of the outline's area that lies outside all `holes`, whether there is
/// material or not. The holes are outlines of the same tool, at most kMaxPendingHoles. A fraction
/// within 1e-9 of 0 or 1 is set to exactly 0 or 1. An empty outline gives 1. No allocation.
double outline_outside(const Tool& tool, const LatticeOutline& outline,
                       std::span<const LatticeOutline> holes) noexcept;

}  // namespace trocar::runtime
