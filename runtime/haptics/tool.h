// SPDX-License-Identifier: Apache-2.0
// The tool: its shape, the elements that act on it, and the forces on its shaft.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstdint>

#include "formats/mesh/lattice.h"
#include "formats/mesh/slice_mesh.h"
#include "formats/session/scene.h"
#include "runtime/device/device.h"

namespace trocar::runtime {

// The springs, dampers and friction elements that act on the tool at one pose: their forces, the change of
// these forces when the tool moves a little further, and the energy that they store.

/// Forces on the tool in the device's frame {B}. The unit vector `axis` points up the shaft. If the
/// tool moves by the vector m without turning, the part of the shaft below the plane of each hole
/// becomes longer by -m_z / axis_z (measured along the shaft).
struct LocalEnvironment {
  // The sheet in contact acts along z with a spring and a damper. Together they never pull
  // the tool down.
  double sheet_N = 0;  ///< force of the sheet's spring
  double sheet_N_per_m = 0, sheet_N_s_per_m = 0;
  // Friction acts along `axis` on the shaft, in all holes that the shaft is in. Dry friction is a
  // spring that slides at its maximum force.
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();
  double dry_N = 0, dry_max_N = 0;  ///< dry friction and its maximum, summed over the holes
  /// Stiffness of dry friction against a small motion of the shaft inwards (`in`) and outwards
  /// (`out`). A friction spring that already has its maximum force in a direction is not counted
  /// for that direction, because the motion no longer increases its force.
  double dry_in_N_per_m = 0, dry_out_N_per_m = 0;
  double viscous_N_s_per_m = 0;
  // The rims (boundaries) of the holes push the shaft sideways. Each rim acts in the plane of its
  // sheet, at the intersection of the tool's axis and this plane.
  Eigen::Vector2d rim_N = Eigen::Vector2d::Zero();
  double rim_N_per_m = 0;
  double stored_J = 0;  ///< energy of all springs
};

// The tool, which is a prism on the plate, and the tool's outline on the lattice of a slice (the
// integer grid of its mesh). The outline determines the coverage and the shape of the hole.

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

// Forces on the shaft in the hole of a punctured sheet. Along the shaft there is dry and viscous
// friction (A. Okamura, C. Simone, M. O'Leary, Force modeling for needle insertion into soft
// tissue, IEEE TBME 51(10), 2004). Sideways the rim, which is the hole's boundary, resists being
// pushed aside.
//
// Contract:
//  1. Dry friction is a spring between shaft and hole. The spring's force rises linearly with its
//     deflection. At the deflection `presliding_m` the force is dry_friction_N, and beyond it the
//     spring slides with this force (after P. Dahl, 1968, with a linear rise). The work of the
//     force on the shaft over a closed motion is never positive.
//  2. The rim's force lies in the sheet's plane. It opposes the displacement of the shaft's axis
//     from the position at which the shaft entered the hole. (The shaft enters a hole at the
//     puncture, or when it returns to an old hole.) The displacement begins at 0, so entering a
//     hole neither stores nor releases energy. After ticks without forces (reset_motion()) it
//     begins at 0 again, wherever the shaft is then.

/// State kept between ticks.
struct ShaftState {
  /// Axis position from which the rim's displacement is measured.
  Eigen::Vector2d hole_m = Eigen::Vector2d::Zero();
  double last_m = 0;     ///< ShaftSection::inserted_m of the last tick
  double spring_m = 0;   ///< deflection of the friction spring, within +-presliding_m
  double viscous_N = 0;  ///< viscous friction along the axis in the last tick
  bool in_hole = false;
  bool has_last = false;           ///< last_m can be used
  bool has_hole_position = false;  ///< hole_m can be used
};

/// The shaft in a sheet's plane, in {B}.
struct ShaftSection {
  Eigen::Vector3d at_m = Eigen::Vector3d::Zero();   ///< intersection of axis and plane
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();  ///< unit vector up the shaft
  double inserted_m = 0;                            ///< length of the shaft below the plane
};

/// Puts the shaft into a hole at the shaft's present position. Friction and the rim's
/// force start at 0.
void enter_hole(const ShaftSection& section, ShaftState& state) noexcept;

/// Call this in ticks without shaft_force(). The shaft stays in its hole. Friction and the rim's
/// force restart at 0 in the next shaft_force().
void reset_motion(ShaftState& state) noexcept;

/// ShaftSection::inserted_m at an earlier pose.
struct PreviousShaft {
  double inserted_m = 0;
  double ago_s = 0;  ///< time since that pose; 0: there is no earlier pose
};

/// Returns the force on the tool at `section.at_m`, in {B}. If the shaft is not in a hole, the
/// force is zero and `state` is unchanged. `pose_interval_s`: as for update_contact() (puncture.h).
/// `previous`: the inserted length at the earlier pose that update_contact() was given.
Eigen::Vector3d shaft_force(const ShaftTissue& tissue, const ShaftSection& section,
                            double pose_interval_s, ShaftState& state,
                            const PreviousShaft& previous = {}) noexcept;

/// Adds to `local` the springs and dampers whose force the last shaft_force() returned.
void add_shaft(const ShaftTissue& tissue, const ShaftSection& section, const ShaftState& state,
               LocalEnvironment& local) noexcept;

/// Call this after the tool was set to another position (shift_tool() in puncture.h), so that the
/// shaft's inserted length grew by `inserted_m`. Friction then ignores this jump.
void shift_shaft(double inserted_m, ShaftState& state) noexcept;

}  // namespace trocar::runtime
