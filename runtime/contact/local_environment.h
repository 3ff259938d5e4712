// SPDX-License-Identifier: Apache-2.0
// The springs, dampers and friction elements that act on the tool at one pose: their forces, the change of
// these forces when the tool moves a little further, and the energy that they store.
// Tests: tests/runtime/contact/virtual_coupling_test.cpp
#pragma once

#include <Eigen/Core>

namespace trocar::runtime {

/// Forces on the tool in {B}. If the tool moves by the vector m, the length of the shaft below each hole
/// grows by -m_z / axis_z.
struct LocalEnvironment {
  // The sheet in contact acts along z. The sum of its spring and damper never pulls.
  double sheet_N = 0;  ///< force of the sheet's spring
  double sheet_N_per_m = 0, sheet_N_s_per_m = 0;
  // Friction acts on the shaft in all of its holes, along the unit vector `axis`, which points up the shaft.
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();
  double dry_N = 0, dry_max_N = 0;
  /// Sum of the stiffnesses of the friction springs that do not slide yet: if the shaft moves inwards, and
  /// if it moves outwards.
  double dry_in_N_per_m = 0, dry_out_N_per_m = 0;
  double viscous_N_s_per_m = 0;
  // The rims of the holes push the shaft in the plane of the sheet, at the intersection of the tool's axis
  // and this plane.
  Eigen::Vector2d rim_N = Eigen::Vector2d::Zero();
  double rim_N_per_m = 0;
  double stored_J = 0;  ///< energy of all springs
};

}  // namespace trocar::runtime
