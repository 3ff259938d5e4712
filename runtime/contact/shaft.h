// SPDX-License-Identifier: Apache-2.0
// The shaft in the hole of a punctured sheet: dry and viscous friction along it (A. Okamura,
// C. Simone, M. O'Leary, Force modeling for needle insertion into soft tissue, IEEE TBME 51(10),
// 2004) and the rim's resistance to being pushed aside.
//
// Contract (tests/runtime/contact/shaft_test.cpp):
//  1. Dry friction is a spring of length `presliding_m` that slides at its end (P. Dahl 1968, with
//     a linear rise): it never exceeds dry_friction_N, opposes the motion, and dissipates: over a
//     closed motion its work on the shaft is never positive.
//  2. The rim's force lies in the sheet's plane, against the displacement of the shaft's axis from
//     where it was when it entered the hole: at the puncture, or when it came back. So entering a
//     hole takes and gives no energy.
#pragma once

#include <Eigen/Core>

#include "formats/session/scene.h"
#include "runtime/contact/local_environment.h"

namespace trocar::runtime {

/// Kept between ticks.
struct ShaftState {
  Eigen::Vector2d hole_m = Eigen::Vector2d::Zero();  ///< the axis in the sheet, on entering
  double last_m = 0;                                 ///< inserted length in the last tick
  double spring_m = 0;                               ///< within +-presliding_m
  double viscous_N = 0;                              ///< along the axis, in the last tick
  bool in_hole = false;
  bool has_last = false;
};

/// Where the axis meets the sheet's plane in {B}, its direction (unit, up the shaft), and how much
/// of the shaft, measured along it, is below.
struct ShaftPlace {
  Eigen::Vector3d at_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();
  double inserted_m = 0;
};

void enter_hole(const ShaftPlace& place, ShaftState& state) noexcept;

/// For ticks in which no force is computed: the shaft stays in its hole, and friction starts again
/// from 0 at its next place.
void reset_motion(ShaftState& state) noexcept;

/// How much was inserted at an EarlierPose.
struct EarlierShaft {
  double inserted_m = 0;
  double ago_s = 0;  ///< as in EarlierPose
};

/// The force on the tool at `place.at_m`, in {B}. Unless in_hole it is zero, and `state` is
/// unchanged. `pose_interval_s`, `earlier`: as in update_contact.
Eigen::Vector3d shaft_force(const ShaftTissue& tissue, const ShaftPlace& place,
                            double pose_interval_s, ShaftState& state,
                            const EarlierShaft& earlier = {}) noexcept;

/// Adds the elements of the last shaft_force() to `local`.
void add_shaft(const ShaftTissue& tissue, const ShaftPlace& place, const ShaftState& state,
               LocalEnvironment& local) noexcept;

/// The shaft was moved without a force, by `inserted_m` further in: the next tick's rate does not
/// count it.
void shift_shaft(double inserted_m, ShaftState& state) noexcept;

}  // namespace trocar::runtime
