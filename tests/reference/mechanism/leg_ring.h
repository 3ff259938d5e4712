// SPDX-License-Identifier: Apache-2.0
// The mechanism with any number of legs at equal azimuths, for analysis only. The paper justifies
// the fourth leg, whose two motors are redundant, by the singularities that it removes; LegRing<3>,
// six motors, is the device without it. All lengths, heights and branches are the description's, so
// that only the number of legs differs. (They were optimised for four legs; others may suit three
// better.) LegRing<4> equals kinematics.h and jacobian.h.
#pragma once

#include <cmath>
#include <numbers>

#include "runtime/device/four_legs/kinematics.h"
#include "tests/reference/decompositions/decompositions.h"

namespace trocar::runtime {

template <int Legs>
struct LegRing {
  static constexpr int kRows = 2 * Legs;
  using Matrix = Eigen::Matrix<double, kRows, 6>;

  struct Result {
    KinematicsStatus status;
    Matrix G = Matrix::Zero();  ///< rows as in Jacobian: leg-major th1, th4
    Eigen::Matrix<double, kRows, 1> motor_rad = Eigen::Matrix<double, kRows, 1>::Zero();
  };

  static leg::Azimuth azimuth(int m) noexcept {
    const double angle = 2 * std::numbers::pi * m / Legs;
    return {std::cos(angle), std::sin(angle)};
  }

  /// Inverse kinematics and Jacobian of a pose.
  static Result solve(const DeviceDescription& device, const Pose& T_device_plate) noexcept {
    Result result;
    const DeviceGeometry& g = device.geometry;
    for (int m = 0; m < Legs; ++m) {
      const leg::Azimuth a = azimuth(m);
      const Eigen::Vector3d r = T_device_plate.q * leg::plate_joint(g, a);
      const Eigen::Vector3d C = leg::to_leg(a, T_device_plate.p_m + r);
      std::array<double, kJointsPerLeg> theta{};
      Eigen::Vector3d w1, w4;
      KinematicsStatus& status = result.status;
      status = leg::inverse(device, C, {g.branch_theta1, g.branch_theta4}, theta);
      if (status) status = leg::motor_rates(g, C, theta[0], theta[3], w1, w4);
      if (!status) {
        status.leg = m + 1;
        return result;
      }
      result.motor_rad.template segment<2>(2 * m) << theta[0], theta[3];
      w1 = leg::from_leg(a, w1);
      w4 = leg::from_leg(a, w4);
      result.G.row(2 * m) << w1.transpose(), r.cross(w1).transpose();
      result.G.row(2 * m + 1) << w4.transpose(), r.cross(w4).transpose();
    }
    return result;
  }

  /// Singular values in descending order, with rotation divided by the characteristic length.
  static Eigen::VectorXd singular_values(Matrix G, double characteristic_length_m) {
    G.template rightCols<3>() /= characteristic_length_m;
    return reference::singular_values(G);
  }
};

}  // namespace trocar::runtime
