// SPDX-License-Identifier: Apache-2.0
// The shaft in the hole of a sheet that gave way: dry and viscous friction along it (A. Okamura,
// C. Simone, M. O'Leary, Force modeling for needle insertion into soft tissue, IEEE TBME 51(10),
// 2004) and the rim's resistance to being pushed aside.
//
// Laws (tests/runtime/contact/shaft_test.cpp):
//  1. Dry friction is a spring of length `presliding_m` that slides along at its end (P. Dahl
//     1968 with a linear rise): it never exceeds dry_friction_N, opposes the motion, and takes up
//     from any closed motion at least as much energy as it gives back.
//  2. The rim's force is in the sheet's plane, against the displacement of the shaft's axis from
//     where it was when the sheet gave way.
#pragma once

#include <Eigen/Core>

#include "formats/session/scene.h"

namespace trocar::runtime {

/// Between ticks.
struct ShaftState {
  bool in_hole = false;
  Eigen::Vector2d hole_m = Eigen::Vector2d::Zero();  ///< the axis in the sheet when it gave way
  bool has_last = false;
  double last_m = 0;     ///< inserted length in the last tick
  double spring_m = 0;   ///< within +-presliding_m
  double viscous_N = 0;  ///< along the axis, in the last tick
};

/// Where the axis meets the sheet's plane in {B}, its direction (unit, up the shaft), and how much
/// of the shaft, measured along it, is below.
struct ShaftPlace {
  Eigen::Vector3d at_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();
  double inserted_m = 0;
};

void enter_hole(const ShaftPlace& place, ShaftState& state) noexcept;

/// Ticks are missed from here on, in which forces are not rendered: the shaft stays in its hole,
/// and friction begins anew from where the shaft is next met.
void forget_motion(ShaftState& state) noexcept;

/// The force on the tool at `place.at_m`, in {B}. Zero, and nothing is kept, unless in_hole.
/// `moved_over_s`: as in update_contact.
Eigen::Vector3d shaft_force(const ShaftTissue& tissue, const ShaftPlace& place, double moved_over_s,
                            ShaftState& state) noexcept;

}  // namespace trocar::runtime
