// SPDX-License-Identifier: Apache-2.0
#include "runtime/mechanism/pose_covariance.h"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <cmath>
#include <numbers>

#include "runtime/mechanism/leg.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;

// From d(measurements) = A dx and d(measurements) = B de: dx = A^+ B de. Rotation's
// columns are scaled to metres for the rank's sake.
template <int Rows, int Errors>
PoseCovarianceResult propagate(Eigen::Matrix<double, Rows, 6> A,
                               const Eigen::Matrix<double, Rows, Errors>& B,
                               double deviation_rad) noexcept {
  PoseCovarianceResult result;
  A.template rightCols<3>() /= kCharacteristicLength_m;
  if (!A.allFinite() || !B.allFinite() || !std::isfinite(deviation_rad)) {
    result.status.failure = KinematicsFailure::kBadInput;
    return result;
  }
  const Eigen::LDLT<Eigen::Matrix<double, 6, 6>> normal(A.transpose() * A);
  const auto pivot = normal.vectorD().cwiseAbs();
  if (!(pivot.minCoeff() > 1e-12 * pivot.maxCoeff())) {
    result.status.failure = KinematicsFailure::kSingular;
    return result;
  }
  Eigen::Matrix<double, 6, Errors> gain = normal.solve(A.transpose() * B);
  gain.template bottomRows<3>() /= kCharacteristicLength_m;
  result.covariance = (deviation_rad * deviation_rad) * gain * gain.transpose();
  return result;
}

}  // namespace

double quantisation_deviation_rad(int counts_per_revolution) noexcept {
  if (counts_per_revolution <= 0) return 0;
  return 2 * std::numbers::pi / counts_per_revolution / std::sqrt(12.0);
}

PoseCovarianceResult covariance_from_motors(const DeviceDescription& device,
                                            const Pose& T_device_plate, const JointAngles& joints,
                                            double deviation_rad) noexcept {
  const DeviceGeometry& g = device.geometry;
  const double k = g.l5_m / g.l2_m;
  Eigen::Matrix<double, kMotors, 6> A;
  Eigen::Matrix<double, kMotors, kMotors> B = Eigen::Matrix<double, kMotors, kMotors>::Zero();
  for (int m = 0; m < kLegs; ++m) {
    const double th1 = joints.theta_rad[m][0], th4 = joints.theta_rad[m][3];
    const Vector3d r = T_device_plate.q * leg::plate_joint(g, m);
    const Vector3d C = leg::to_leg(m, T_device_plate.p_m + r);
    const Vector3d E = leg::elbow(g, th1);
    const Vector3d upper = (C - E).normalized();
    const Vector3d lower = (leg::link_joint(g, E, C) - leg::lower_elbow(g, th4)).normalized();
    const int up = motor_index(m, 0), low = motor_index(m, 1);
    const Vector3d n_upper = leg::from_leg(m, upper), n_lower = k * leg::from_leg(m, lower);
    A.row(up) << n_upper.transpose(), r.cross(n_upper).transpose();
    A.row(low) << n_lower.transpose(), r.cross(n_lower).transpose();
    const Vector3d E_th1 = g.l1_m * leg::upper_derivative(th1);
    B(up, up) = -upper.dot(E_th1);
    B(low, up) = (1 - k) * lower.dot(E_th1);
    B(low, low) = -lower.dot(g.l3_m * leg::lower_derivative(th4));
  }
  return propagate<kMotors, kMotors>(A, B, deviation_rad);
}

PoseCovarianceResult covariance_from_encoders(const DeviceDescription& device,
                                              const Pose& T_device_plate, const JointAngles& joints,
                                              double deviation_rad) noexcept {
  const DeviceGeometry& g = device.geometry;
  Eigen::Matrix<double, 3 * kLegs, 6> A;
  Eigen::Matrix<double, 3 * kLegs, 3 * kLegs> B =
      Eigen::Matrix<double, 3 * kLegs, 3 * kLegs>::Zero();
  for (int m = 0; m < kLegs; ++m) {
    const auto& th = joints.theta_rad[m];
    const Vector3d r = T_device_plate.q * leg::plate_joint(g, m);
    A.block<3, 3>(3 * m, 0).setIdentity();
    A.block<3, 3>(3 * m, 3) << 0, r.z(), -r.y(), -r.z(), 0, r.x(), r.y(), -r.x(), 0;
    const Vector3d E_th1 = g.l1_m * leg::upper_derivative(th[0]);
    const Vector3d swing = g.l2_m * std::cos(th[2]) * leg::upper_derivative(th[0] + th[1]);
    const Vector3d lift = g.l2_m * (-std::sin(th[2]) * leg::upper_direction(th[0] + th[1]) +
                                    std::cos(th[2]) * Vector3d::UnitY());
    B.block<3, 3>(3 * m, 3 * m) << leg::from_leg(m, E_th1 + swing), leg::from_leg(m, swing),
        leg::from_leg(m, lift);
  }
  return propagate<3 * kLegs, 3 * kLegs>(A, B, deviation_rad);
}

}  // namespace trocar::runtime
