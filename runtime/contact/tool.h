// SPDX-License-Identifier: Apache-2.0
// The tool, which is a prism on the plate, and the tool's outline on the lattice of a slice (the
// integer grid of its mesh). The outline determines the coverage and the shape of the hole.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstdint>

#include "formats/geometry/lattice.h"
#include "formats/geometry/lattice_box.h"
#include "formats/geometry/slice_mesh.h"
#include "formats/session/scene.h"
#include "runtime/device/pose.h"

namespace trocar::runtime {

/// A convex part of the tool's cross-section, given by the indices of its corners, counter-clockwise.
struct ConvexPiece {
  int size = 0;
  std::array<std::uint8_t, kMaxToolSides> corner{};
};
/// Largest number of convex parts of a tool. place_slices() refuses a tool that has more parts.
inline constexpr int kMaxToolPieces = 8;

struct Tool {
  int sides = 0;
  /// Corners of the tool's lower end in the plate's frame, counter-clockwise if seen along -axis.
  std::array<Eigen::Vector3d, kMaxToolSides> corner_plate_m;
  Eigen::Vector3d tip_plate_m = Eigen::Vector3d::Zero();  ///< lower end of the tool's axis
  Eigen::Vector3d axis_plate = Eigen::Vector3d::UnitZ();  ///< unit vector up the shaft
  /// Unit vector along the cross-section's x axis, which SceneTool::rotation_deg rotates about the
  /// tool's axis.
  Eigen::Vector3d side_plate = Eigen::Vector3d::UnitX();
  /// Number of convex parts that tile the cross-section. 0: the tool has more than kMaxToolPieces.
  int pieces = 0;
  std::array<ConvexPiece, kMaxToolPieces> piece;
};

/// Makes the tool of a scene. To find its convex parts, the cross-section is divided into triangles
/// (by ear clipping), and parts whose union is convex are merged (Hertel and Mehlhorn). O(sides^3).
Tool make_tool(const SceneTool& scene_tool);

/// Placement of a slice in {B} (formats/session/scene.h, Placement).
struct PlanarTransform {
  Eigen::Vector2d at_m = Eigen::Vector2d::Zero();
  Eigen::Vector2d anchor_mm = Eigen::Vector2d::Zero();
  double cosine = 1, sine = 0;  ///< cosine and sine of the rotation about z
  Lattice lattice;

  /// to_lattice() converts x, y in {B} to lattice steps, not rounded. to_scene() is the inverse.
  Eigen::Vector2d to_lattice(const Eigen::Vector2d& p_m) const noexcept;
  Eigen::Vector2d to_scene(const Eigen::Vector2d& steps) const noexcept;
};

/// A simple counter-clockwise polygon on the lattice. Size 0: no outline.
struct LatticeOutline {
  int size = 0;
  std::array<LatticePoint, kMaxToolSides> points;
  friend bool operator==(const LatticeOutline& a, const LatticeOutline& b) {
    return a.size == b.size &&
           std::equal(a.points.begin(), a.points.begin() + a.size, b.points.begin());
  }
};
Ring to_ring(const LatticeOutline& outline);
/// Returns the bounding box of an outline. Precondition: the outline is not empty.
LatticeBox box_around(const LatticeOutline& outline) noexcept;

/// True if the axis is within kMaxTilt_deg of {B}'s z. Only an upright tool has outlines.
bool is_upright(const Tool& tool, const Pose& T_device_plate) noexcept;

/// Returns the intersection of the tool's axis, extended beyond the tip if necessary, with the
/// plane z = z_m of {B}. Precondition: is_upright().
Eigen::Vector3d axis_at(const Tool& tool, const Pose& T_device_plate, double z_m) noexcept;

/// Returns the section of the prism with the plane z = z_m, with each corner rounded to the
/// lattice. The section of a tilted tool is stretched along the tilt, by a factor of at most
/// sqrt(2). The outline is a simple polygon if smallest_clearance_m() is at least kMinClearance
/// lattice steps. (The section is nowhere narrower than the cross-section. Rounding moves a corner
/// by at most sqrt(1/2) steps, so it reduces a clearance by less than kMinClearance.) If the tool
/// is not upright, or if a coordinate of a corner exceeds kMaxCoordinate / 2, the outline has size
/// 0. No allocation.
LatticeOutline outline_on_lattice(const Tool& tool, const Pose& T_device_plate,
                                  const PlanarTransform& transform, double z_m) noexcept;
inline constexpr double kMinClearance = 1.5;  ///< smallest clearance, in lattice steps

/// Returns the smallest distance between a corner of the cross-section and an edge that does not
/// end at this corner.
double smallest_clearance_m(const Tool& tool) noexcept;

}  // namespace trocar::runtime
