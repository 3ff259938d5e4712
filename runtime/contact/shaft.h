// SPDX-License-Identifier: Apache-2.0
// Forces on the shaft in the hole of a punctured sheet: dry and viscous
// friction along the shaft (A. Okamura, C. Simone, M. O'Leary, Force modeling for needle insertion into soft
// tissue, IEEE TBME 51(10), 2004) and the resistance of the rim to being pushed aside.
//
// Contract (tests/runtime/contact/shaft_test.cpp):
//  1. Dry friction is a spring between shaft and hole. Its force opposes the motion. It rises linearly with
//     the spring's deflection up to `presliding_m` and is dry_friction_N there. From then on the spring
//     slides (after P. Dahl, 1968, with a linear rise). The work of the force on the shaft over a closed
//     motion is never positive.
//  2. The rim's force lies in the sheet's plane. It opposes the displacement of the shaft's axis from the
//     position at which the shaft entered the hole, either at the puncture or when it returned. Entering a
//     hole therefore neither stores nor releases energy.
#pragma once

#include <Eigen/Core>

#include "formats/session/scene.h"
#include "runtime/contact/local_environment.h"

namespace trocar::runtime {

/// State kept between ticks.
struct ShaftState {
  Eigen::Vector2d hole_m = Eigen::Vector2d::Zero();  ///< axis position when the shaft entered
  double last_m = 0;                                 ///< inserted length in the last tick
  double spring_m = 0;                               ///< deflection, within +-presliding_m
  double viscous_N = 0;  ///< viscous friction along the axis in the last tick
  bool in_hole = false;
  bool has_last = false;
};

/// The shaft in a sheet's plane: intersection of axis and plane in {B}, direction of the axis (unit vector up
/// the shaft), and length of the shaft below the plane.
struct ShaftSection {
  Eigen::Vector3d at_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();
  double inserted_m = 0;
};

void enter_hole(const ShaftSection& section, ShaftState& state) noexcept;

/// Call this in ticks without shaft_force(). The shaft stays in its hole, and friction restarts at 0.
void reset_motion(ShaftState& state) noexcept;

/// Inserted length at an earlier pose.
struct PreviousShaft {
  double inserted_m = 0;
  double ago_s = 0;  ///< PreviousPose::ago_s
};

/// Returns the force on the tool at `section.at_m`, in {B}. If the shaft is not in a hole, the force is zero
/// and `state` is unchanged. `pose_interval_s`, `previous`: as for update_contact().
Eigen::Vector3d shaft_force(const ShaftTissue& tissue, const ShaftSection& section,
                            double pose_interval_s, ShaftState& state,
                            const PreviousShaft& previous = {}) noexcept;

/// Adds the elements of the last shaft_force() to `local`.
void add_shaft(const ShaftTissue& tissue, const ShaftSection& section, const ShaftState& state,
               LocalEnvironment& local) noexcept;

/// Call this if the shaft moved in by `inserted_m` without a force. The rate of the next tick
/// ignores this motion.
void shift_shaft(double inserted_m, ShaftState& state) noexcept;

}  // namespace trocar::runtime
