// SPDX-License-Identifier: Apache-2.0
// The potential that the proxy minimises, with its first and second derivatives by the proxy's
// displacement (translation and turn about the plate's origin, in {B}).
#pragma once

#include "runtime/cutting/tick.h"

namespace trocar::runtime {

/// All of the potential at one pose.
struct Evaluation {
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  using Vector6 = Eigen::Matrix<double, 6, 1>;

  Pose X;
  double V = 0, coupling_J = 0, friction_J = 0, wall_J = 0, viscous_J = 0, layer_J = 0,
         tip_friction_J = 0;
  double pressed_N_per_m = 0;  ///< stiffness of tip and layers
  double tip_N = 0, coupling_N = 0;
  Eigen::Vector2d slide = Eigen::Vector2d::Zero();      ///< since the tick's start: along, around
  Vector6 along = Vector6::Zero();                      ///< derivative of slide[0]
  Eigen::Vector3d around = Eigen::Vector3d::Zero();     ///< of slide[1], for turns
  Eigen::Vector3d tip_slide = Eigen::Vector3d::Zero();  ///< across the axis since the start
  Vector6 coupling = Vector6::Zero();
  Vector6 g = Vector6::Zero();
  Matrix6 H = Matrix6::Zero();
  bool walls_yield = false, is_saturated = false;  ///< the coupling, at its limits
};

/// With `majorise` H is that of a parabola above the potential where elements yield.
void evaluate(const Tick& tick, const Pose& X, bool majorise, Evaluation& e,
              CuttingResult& out) noexcept;

}  // namespace trocar::runtime
