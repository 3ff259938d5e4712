// SPDX-License-Identifier: Apache-2.0
// The device's equation of motion for the twist V = [v; omega] of the plate's origin, in {B}:
//   M(pose) V' + h(pose, V) = sum of the wrenches on the plate about its origin.
// V' is the time derivative of V. The plate is a rigid body. Each link is modelled by two point
// masses, half of its mass at each end. An end on a motor's axis does not move and is left out.
// Each motor is a rotor inertia at its joint. The hand's mass is a point mass at the tool's tip.
// Let M_plate be the plate's mass matrix, I its moment of inertia in {B}, I_rotor the inertia of a
// rotor, G the motors' Jacobian, and J_i the Jacobian of the point mass m_i. Then
//   M = M_plate + I_rotor G^T G + sum m_i J_i^T J_i,
//   h = [0; omega x (I omega)] + I_rotor G^T a_motors + sum m_i J_i^T a_i.
// Here a_motors and a_i are the accelerations of the motors' joints and of the point masses if
// V' = 0. In general they are not zero, because the velocity V moves them on curved paths. They are
// computed in closed form. No function allocates or throws.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "formats/session/device_description.h"
#include "runtime/device/device.h"
#include "runtime/device/four_legs/kinematics.h"

namespace trocar::runtime {

/// Properties that the paper does not give. Every default is an assumption: aluminium links of
/// about 10 mm diameter, motors that act on the joints through one bevel pair, and drives whose
/// current loop has a bandwidth of 500 Hz. Dry friction is modelled by a spring in each motor
/// joint. The spring slips when its torque reaches the Coulomb friction.
struct MechanicsOptions {
  std::array<double, 4> link_mass_kg = {0.06, 0.08, 0.04, 0.04};  ///< masses of l1, l2, l3, l4
  /// Inertia of each rotor as it acts at its joint: the rotor's own inertia times the square of the
  /// gear ratio.
  double rotor_inertia_kg_m2 = 1.5e-4;
  double coulomb_friction_Nm = 0.004;  ///< Coulomb friction of each motor joint
  double presliding_rad = 5e-4;        ///< deflection at which the spring of dry friction slips
  double presliding_damping_s = 1e-3;  ///< damping of this spring divided by its stiffness
  /// Time constant with which a torque follows its command; 0: no lag.
  double current_lag_s = 3e-4;
  double encoder_noise_rad = 0;  ///< standard deviation of an angle's noise, before quantisation
  std::uint64_t seed = 1;        ///< seed of the noise
  /// Options with massless links and rotors, and without dry friction, lag and noise.
  static constexpr MechanicsOptions none() noexcept {
    return {{0, 0, 0, 0}, 0, 0, 5e-4, 1e-3, 0, 0, 1};
  }
};

using MassMatrix = Eigen::Matrix<double, 6, 6>;

/// The terms of the equation of motion at a pose and a twist.
struct Mechanics {
  KinematicsStatus status;        ///< status of the Jacobian; if not kOk, the rest is invalid
  Jacobian G = Jacobian::Zero();  ///< maps the twist to the rates of the motors' joints
  MassMatrix mass = MassMatrix::Zero();
  Wrench bias = Wrench::Zero();    ///< the term h
  Wrench weight = Wrench::Zero();  ///< weight of plate and links under the description's gravity
};

/// Evaluates the equation of motion. Precondition: `joints` are the joint angles of the pose.
/// `tip_mass_kg`: the hand's mass, which moves with the tip and has no weight. `lever_m`: the
/// vector from the plate's origin to the tip, in {B}.
Mechanics mechanics(const DeviceDescription& device, const MechanicsOptions& options,
                    const Pose& T_device_plate, const JointAngles& joints,
                    const Twist& twist_device, double tip_mass_kg,
                    const Eigen::Vector3d& lever_m) noexcept;

}  // namespace trocar::runtime
