// SPDX-License-Identifier: Apache-2.0
#include "runtime/mechanism/jacobian.h"

#include <Eigen/QR>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

#include "runtime/decompositions/symmetric_eigenvalues.h"
#include "runtime/mechanism/leg.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;

// Smallest ratio of singular values for which G^T G, which squares the ratio, gives the
// smallest one accurately.
constexpr double kSmallestSquared = 1e-3;

// Returns the row whose product with the twist is w . C', where C' = v + omega x r is the
// velocity of C.
Eigen::Matrix<double, 1, 6> point_row(const Vector3d& w, const Vector3d& r) noexcept {
  Eigen::Matrix<double, 1, 6> row;
  row << w.transpose(), r.cross(w).transpose();
  return row;
}

}  // namespace

JacobianResult jacobian(const DeviceDescription& device, const Pose& T_device_plate,
                        const JointAngles& joints) noexcept {
  JacobianResult result;
  const DeviceGeometry& g = device.geometry;
  for (int m = 0; m < kLegs; ++m) {
    const Vector3d r = T_device_plate.q * leg::plate_joint(g, m);
    const Vector3d C = leg::to_leg(m, T_device_plate.p_m + r);
    Vector3d w1, w4;
    const auto& theta = joints.theta_rad[m];
    result.status = leg::motor_rates(g, C, theta[0], theta[3], w1, w4);
    if (!result.status) {
      result.status.leg = m + 1;
      return result;
    }
    result.G.row(motor_index(m, 0)) = point_row(leg::from_leg(m, w1), r);
    result.G.row(motor_index(m, 1)) = point_row(leg::from_leg(m, w4), r);
  }
  return result;
}

SingularRange singular_range(const Jacobian& G) noexcept {
  Jacobian scaled = G;
  scaled.rightCols<3>() /= kCharacteristicLength_m;
  if (!scaled.allFinite()) return {};
  const Eigen::Matrix<double, 6, 6> normal = scaled.transpose() * scaled;
  if (const auto squared = symmetric_eigenvalues(normal)) {
    const SingularRange range = {std::sqrt(std::max(0.0, (*squared)[0])),
                                 std::sqrt(std::max(0.0, (*squared)[5]))};
    if (range.smallest > kSmallestSquared * range.largest) return range;
  }
  // This takes longer, but is needed only near a singularity. scaled = Q R, so that R has
  // the same singular values; as a square matrix it needs no preconditioner, which compiles slowly.
  const Eigen::Matrix<double, 6, 6> R =
      Eigen::HouseholderQR<Jacobian>(scaled).matrixQR().topRows<6>().triangularView<Eigen::Upper>();
  const Eigen::JacobiSVD<Eigen::Matrix<double, 6, 6>, Eigen::NoQRPreconditioner> svd(R);
  if (svd.info() != Eigen::Success) return {};
  return {svd.singularValues()[5], svd.singularValues()[0]};
}

}  // namespace trocar::runtime
