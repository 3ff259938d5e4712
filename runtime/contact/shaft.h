// SPDX-License-Identifier: Apache-2.0
// Forces on the shaft in the hole of a punctured sheet. Along the shaft there is dry and viscous
// friction (A. Okamura, C. Simone, M. O'Leary, Force modeling for needle insertion into soft
// tissue, IEEE TBME 51(10), 2004). Sideways the rim, which is the hole's boundary, resists being
// pushed aside.
//
// Contract (tests/runtime/contact/shaft_test.cpp):
//  1. Dry friction is a spring between shaft and hole. The spring's force rises linearly with its
//     deflection. At the deflection `presliding_m` the force is dry_friction_N, and beyond it the
//     spring slides with this force (after P. Dahl, 1968, with a linear rise). The work of the
//     force on the shaft over a closed motion is never positive.
//  2. The rim's force lies in the sheet's plane. It opposes the displacement of the shaft's axis
//     from the position at which the shaft entered the hole. (The shaft enters a hole at the
//     puncture, or when it returns to an old hole.) The displacement begins at 0, so entering a
//     hole neither stores nor releases energy. After ticks without forces (reset_motion()) it
//     begins at 0 again, wherever the shaft is then.
#pragma once

#include <Eigen/Core>

#include "formats/session/scene.h"
#include "runtime/contact/local_environment.h"

namespace trocar::runtime {

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
