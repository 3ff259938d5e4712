// SPDX-License-Identifier: Apache-2.0
#include "tests/reference/mechanism/twist_from_motor_rates.h"

#include <Eigen/QR>
#include <cmath>

namespace trocar::runtime {

TwistResult twist_from_motor_rates(const Jacobian& G, const MotorVector& motor_rad_per_s) noexcept {
  constexpr double kMinRank = 1e-9;  // of R's diagonal, relative: rank deficient below
  TwistResult result;
  Jacobian scaled = G;
  scaled.rightCols<3>() /= kCharacteristicLength_m;
  if (!scaled.allFinite() || !motor_rad_per_s.allFinite()) {
    result.status.failure = KinematicsFailure::kBadInput;
    return result;
  }
  const Eigen::HouseholderQR<Jacobian> qr(scaled);
  const auto diagonal = qr.matrixQR().diagonal().cwiseAbs();
  if (!(diagonal.minCoeff() > kMinRank * diagonal.maxCoeff())) {
    result.status.failure = KinematicsFailure::kSingular;
    return result;
  }
  const MotorVector in_Q = qr.householderQ().transpose() * motor_rad_per_s;
  result.twist_device =
      qr.matrixQR().topRows<6>().triangularView<Eigen::Upper>().solve(in_Q.head<6>());
  result.twist_device.tail<3>() /= kCharacteristicLength_m;
  result.residual_rad_per_s = in_Q.tail<kMotors - 6>().norm() / std::sqrt(double{kMotors});
  return result;
}

}  // namespace trocar::runtime
