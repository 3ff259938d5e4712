// SPDX-License-Identifier: Apache-2.0
// What acts on the tool at one pose, element by element: how it changes when the tool is moved a
// little further, and how much energy it stores.
#pragma once

#include <Eigen/Core>

namespace trocar::runtime {

/// Forces on the tool in {B}. A translation by m lengthens the shaft in its holes by -m_z / axis_z.
struct LocalEnvironment {
  // The sheet in contact, along z. Together spring and damper never pull.
  double sheet_N = 0;  ///< of the spring
  double sheet_N_per_m = 0, sheet_N_s_per_m = 0;
  // The shaft in all its holes: friction along the axis, unit, up the shaft.
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();
  double dry_N = 0, dry_max_N = 0;
  /// Of the friction's springs that have not reached their end inwards, and outwards.
  double dry_in_N_per_m = 0, dry_out_N_per_m = 0;
  double viscous_N_s_per_m = 0;
  // The rims, in the plane; they act on where the axis meets it.
  Eigen::Vector2d rim_N = Eigen::Vector2d::Zero();
  double rim_N_per_m = 0;
  double stored_J = 0;  ///< in all springs
};

}  // namespace trocar::runtime
