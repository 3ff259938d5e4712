// SPDX-License-Identifier: Apache-2.0
// The elements that act on the tool at one pose: their forces, how these change when the tool moves a little
// further, and the energy that they store.
// Tests: tests/runtime/contact/virtual_coupling_test.cpp
#pragma once

#include <Eigen/Core>

namespace trocar::runtime {

/// Forces on the tool in {B}. A translation by m lengthens the shaft in its holes by -m_z / axis_z.
struct LocalEnvironment {
  // The sheet in contact, along z. The sum of spring and damper never pulls.
  double sheet_N = 0;  ///< force of the spring
  double sheet_N_per_m = 0, sheet_N_s_per_m = 0;
  // The shaft in all its holes: friction along `axis`, a unit vector up the shaft.
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();
  double dry_N = 0, dry_max_N = 0;
  /// Stiffness of the friction springs that can still extend inwards, and outwards.
  double dry_in_N_per_m = 0, dry_out_N_per_m = 0;
  double viscous_N_s_per_m = 0;
  // The rims, in the sheet's plane; they act at the intersection of the axis and the plane.
  Eigen::Vector2d rim_N = Eigen::Vector2d::Zero();
  double rim_N_per_m = 0;
  double stored_J = 0;  ///< energy of all springs
};

}  // namespace trocar::runtime
