// SPDX-License-Identifier: Apache-2.0
// The tool: a regular polygon on the plate, and its outline on a slice's lattice,
// which is at once what overlaps material and what is cut out of it.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>

#include "formats/lattice.h"
#include "formats/scene.h"
#include "formats/slice_mesh.h"
#include "runtime/device/pose.h"

namespace trocar::runtime {

struct Tool {
  int sides = 0;
  /// Corners in the plate's frame, counter-clockwise seen from +z.
  std::array<Eigen::Vector3d, kMaxToolSides> corner_plate_m;
  Eigen::Vector3d tip_plate_m = Eigen::Vector3d::Zero();  ///< their centre
};

Tool make_tool(const SceneTool& scene_tool);

/// Where a slice lies in {B} (formats/scene.h, Placement).
struct PlanarTransform {
  Eigen::Vector2d at_m = Eigen::Vector2d::Zero();
  Eigen::Vector2d anchor_mm = Eigen::Vector2d::Zero();
  double cosine = 1, sine = 0;  ///< of the rotation about z
  Lattice lattice;

  /// x, y in {B} -> lattice steps, not rounded; and back.
  Eigen::Vector2d to_lattice(const Eigen::Vector2d& p_m) const noexcept;
  Eigen::Vector2d to_scene(const Eigen::Vector2d& steps) const noexcept;
};

/// A strictly convex polygon on the lattice, counter-clockwise; size 0: none.
struct LatticeOutline {
  int size = 0;
  std::array<LatticePoint, kMaxToolSides> points;
  friend bool operator==(const LatticeOutline& a, const LatticeOutline& b) {
    return a.size == b.size &&
           std::equal(a.points.begin(), a.points.begin() + a.size, b.points.begin());
  }
};
Ring to_ring(const LatticeOutline& outline);

/// The tool's corners, projected along z, rounded to the lattice, and their convex hull (which
/// for tools of many lattice steps is the polygon itself; rounding can dent a small one). Size 0
/// if fewer than three corners remain or one lies beyond kMaxCoordinate / 2. No allocation.
LatticeOutline outline_on_lattice(const Tool& tool, const Pose& T_device_plate,
                                  const PlanarTransform& transform) noexcept;

}  // namespace trocar::runtime
