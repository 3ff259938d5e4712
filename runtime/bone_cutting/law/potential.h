// SPDX-License-Identifier: Apache-2.0
// Evaluates the potential that the proxy minimises in a tick (the sum of the energies of all
// elements, cutting_law.h), and the potential's first and second derivatives with respect to the
// proxy's displacement. The displacement consists of a translation and of a rotation about the
// plate's origin, in {B}.
#pragma once

#include "runtime/bone_cutting/law/tick.h"

namespace trocar::runtime {

/// The potential and its derivatives at one pose.
struct Evaluation {
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  using Vector6 = Eigen::Matrix<double, 6, 1>;

  Pose X;
  /// The potential V in joules, and the parts that its elements contribute.
  double V = 0, coupling_J = 0, friction_J = 0, wall_J = 0, viscous_J = 0, layer_J = 0,
         tip_friction_J = 0, hold_J = 0, torsion_J = 0;
  double pressed_N_per_m = 0;        ///< sum of the stiffnesses of tip and soft layers
  double pressed_m = 0;              ///< growth of the tip's stretch since the start of the tick
  double tip_N = 0, coupling_N = 0;  ///< force on the tip, and force of the coupling
  /// Displacements of the shaft since the start of the tick, elastic ones included: along its axis,
  /// and around its axis at the tool's radius.
  Eigen::Vector2d slide = Eigen::Vector2d::Zero();
  Vector6 along = Vector6::Zero();                   ///< derivative of slide[0]
  Vector6 press = Vector6::Zero();                   ///< derivative of pressed_m
  Eigen::Vector3d around = Eigen::Vector3d::Zero();  ///< derivative of slide[1] for a rotation
  /// Displacement of the tip perpendicular to Tick::normal since the start of the tick.
  Eigen::Vector3d tip_slide = Eigen::Vector3d::Zero();
  Vector6 coupling = Vector6::Zero();  ///< derivative of coupling_J; also the wrench on the plate
  Vector6 g = Vector6::Zero();         ///< first derivative of V
  Matrix6 H = Matrix6::Zero();         ///< second derivative of V
  /// `walls_yield`: a wall is loaded beyond its strength. `is_saturated`: the coupling is at its
  /// largest force or moment.
  bool walls_yield = false, is_saturated = false;
};

/// Evaluates the potential at the proxy's pose X. If `majorise` is true, H is the second derivative
/// of a parabola that touches the potential at X and lies above the potential elsewhere, even where
/// elements yield (yield_spring.h). The function adds 1 to `out.evaluations`.
void evaluate(const Tick& tick, const Pose& X, bool majorise, Evaluation& e,
              CuttingResult& out) noexcept;

}  // namespace trocar::runtime
