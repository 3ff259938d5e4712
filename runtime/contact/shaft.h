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
//     its position when it entered the hole: at the puncture, or when it came back. Entering a hole
//     therefore neither takes nor releases energy.
#pragma once

#include <Eigen/Core>

#include "formats/session/scene.h"
#include "runtime/contact/local_environment.h"

namespace trocar::runtime {

/// Memory between ticks.
struct ShaftState {
  Eigen::Vector2d hole_m = Eigen::Vector2d::Zero();  ///< axis position in the sheet on entering
  double last_m = 0;                                 ///< inserted length in the last tick
  double spring_m = 0;                               ///< deflection, within +-presliding_m
  double viscous_N = 0;  ///< viscous friction along the axis in the last tick
  bool in_hole = false;
  bool has_last = false;
};

/// Intersection of the axis and the sheet's plane in {B}, the axis direction (unit vector up the shaft), and
/// the length of shaft below the plane.
struct ShaftSection {
  Eigen::Vector3d at_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();
  double inserted_m = 0;
};

void enter_hole(const ShaftSection& section, ShaftState& state) noexcept;

/// Call this in ticks without shaft_force(): the shaft stays in its hole, and friction starts again from 0.
void reset_motion(ShaftState& state) noexcept;

/// The inserted length at a PreviousPose.
struct PreviousShaft {
  double inserted_m = 0;
  double ago_s = 0;  ///< PreviousPose::ago_s
};

/// The force on the tool at `section.at_m`, in {B}. Unless in_hole it is zero, and `state` is
/// unchanged. `pose_interval_s`, `previous`: as in update_contact.
Eigen::Vector3d shaft_force(const ShaftTissue& tissue, const ShaftSection& section,
                            double pose_interval_s, ShaftState& state,
                            const PreviousShaft& previous = {}) noexcept;

/// Adds the elements of the last shaft_force() to `local`.
void add_shaft(const ShaftTissue& tissue, const ShaftSection& section, const ShaftState& state,
               LocalEnvironment& local) noexcept;

/// Reports that the shaft moved in by `inserted_m` without a force: the next tick's rate ignores this motion.
void shift_shaft(double inserted_m, ShaftState& state) noexcept;

}  // namespace trocar::runtime
