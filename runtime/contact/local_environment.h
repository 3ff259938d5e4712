// SPDX-License-Identifier: Apache-2.0
// The springs, dampers and friction elements that act on the tool at one pose: their forces, the change of
// these forces when the tool moves a little further, and the energy that they store.
#pragma once

#include <Eigen/Core>

namespace trocar::runtime {

/// Forces on the tool in the device's frame {B}. The unit vector `axis` points up the shaft. If the
/// tool moves by the vector m without turning, the part of the shaft below the plane of each hole
/// becomes longer by -m_z / axis_z (measured along the shaft).
struct LocalEnvironment {
  // The sheet in contact acts along z with a spring and a damper. Together they never pull
  // the tool down.
  double sheet_N = 0;  ///< force of the sheet's spring
  double sheet_N_per_m = 0, sheet_N_s_per_m = 0;
  // Friction acts along `axis` on the shaft, in all holes that the shaft is in. Dry friction is a
  // spring that slides at its maximum force (shaft.h).
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

}  // namespace trocar::runtime
