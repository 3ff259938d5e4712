// SPDX-License-Identifier: Apache-2.0
// How encoder noise shows in the pose, to first order. Errors of a pose are
// [position error in m; rotation vector in rad, in {B}], so that the true pose is
// the found one turned and moved back by them.
#pragma once

#include <Eigen/Core>

#include "runtime/mechanism/jacobian.h"

namespace trocar::runtime {

using PoseCovariance = Eigen::Matrix<double, 6, 6>;

struct PoseCovarianceResult {
  KinematicsStatus status;
  PoseCovariance covariance = PoseCovariance::Zero();
};

/// Standard deviation of an encoder's quantisation, uniform over one count.
double quantisation_deviation_rad(int counts_per_revolution) noexcept;

/// Of forward_kinematics_from_motors, which is a least squares fit over the eight
/// links' lengths. Those depend on the motor angles by the links' arms, so that with
/// A = d(lengths)/d(pose) and B = d(lengths)/d(angles), the pose's error is
/// -A^+ B e: covariance = deviation^2 A^+ B B^T A^+T. (This is G^+ with each motor
/// weighted by its arm: not the least possible, but what the iteration gives.)
PoseCovarianceResult covariance_from_motors(const DeviceDescription& device,
                                            const Pose& T_device_plate, const JointAngles& joints,
                                            double deviation_rad) noexcept;

/// Of forward_kinematics: th1..th3 move the C_m by the upper chains' coefficients
/// (Eq. 9), and the rigid fit is the least squares pose of the four C_m.
PoseCovarianceResult covariance_from_encoders(const DeviceDescription& device,
                                              const Pose& T_device_plate, const JointAngles& joints,
                                              double deviation_rad) noexcept;

}  // namespace trocar::runtime
