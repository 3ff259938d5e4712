// SPDX-License-Identifier: Apache-2.0
#include "runtime/mechanism/jacobian.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

#include "runtime/mechanism/leg.h"

namespace trocar::runtime {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// How near to stretched or folded a chain may be: sine of the angle left.
constexpr double kSmallestSine = 1e-6;
constexpr double kSmallestRank = 1e-9;  // of R's diagonal, relative: rank deficient below
// Of singular values: below it G^T G, which squares it, has lost what tells the least from zero.
constexpr double kSmallestSquared = 1e-3;

KinematicsStatus singular(int leg, int joint) noexcept {
  return {KinematicsFailure::kSingular, static_cast<std::int8_t>(leg + 1),
          static_cast<std::int8_t>(joint)};
}

// The row whose product with the twist is w . C' for C' = v + omega x r.
Eigen::Matrix<double, 1, 6> point_row(const Vector3d& w, const Vector3d& r) noexcept {
  Eigen::Matrix<double, 1, 6> row;
  row << w.transpose(), r.cross(w).transpose();
  return row;
}

// Eq. 7 (C' = v + omega x r).
Eigen::Matrix<double, 3, 6> point_influence(const Vector3d& r) noexcept {
  Eigen::Matrix<double, 3, 6> G;
  G << 1, 0, 0, 0, r.z(), -r.y(),  //
      0, 1, 0, -r.z(), 0, r.x(),   //
      0, 0, 1, r.y(), -r.x(), 0;
  return G;
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
    if (const auto status = leg::motor_rates(g, C, theta[0], theta[3], w1, w4); !status) {
      result.status = singular(m, status.joint);
      return result;
    }
    result.G.row(motor_index(m, 0)) = point_row(leg::from_leg(m, w1), r);
    result.G.row(motor_index(m, 1)) = point_row(leg::from_leg(m, w4), r);
  }
  return result;
}

JacobianResult influence_jacobian(const DeviceDescription& device, const Pose& T_device_plate,
                                  const JointAngles& joints) noexcept {
  JacobianResult result;
  const DeviceGeometry& g = device.geometry;
  const double k = g.l5_m / g.l2_m;
  for (int m = 0; m < kLegs; ++m) {
    const auto& th = joints.theta_rad[m];
    Matrix3d R_device_leg;
    R_device_leg << leg::kAzimuth[m].cosine, -leg::kAzimuth[m].sine, 0,  //
        leg::kAzimuth[m].sine, leg::kAzimuth[m].cosine, 0,               //
        0, 0, 1;

    // Eq. 9: C' = G_uth_c th_u', by columns for th1, th2, th3.
    const Vector3d E_th1 = g.l1_m * leg::upper_derivative(th[0]);
    const Vector3d swing = g.l2_m * std::cos(th[2]) * leg::upper_derivative(th[0] + th[1]);
    const Vector3d lift = g.l2_m * (-std::sin(th[2]) * leg::upper_direction(th[0] + th[1]) +
                                    std::cos(th[2]) * Vector3d::UnitY());
    Matrix3d G_c_upper, G_D_upper, G_D_lower;
    G_c_upper << E_th1 + swing, swing, lift;
    // Eq. 12: the same D by the upper chain and by the lower one.
    G_D_upper << E_th1 + k * swing, k * swing, k * lift;
    const Vector3d F_th4 = g.l3_m * leg::lower_derivative(th[3]);
    const Vector3d lower_swing = g.l4_m * std::cos(th[5]) * leg::lower_derivative(th[3] + th[4]);
    const Vector3d lower_lift = g.l4_m * (-std::sin(th[5]) * leg::lower_direction(th[3] + th[4]) +
                                          std::cos(th[5]) * Vector3d::UnitZ());
    G_D_lower << F_th4 + lower_swing, lower_swing, lower_lift;

    Matrix3d G_upper_c, G_lower_D;
    double determinant = 0;
    bool invertible = false;
    G_c_upper.computeInverseAndDetWithCheck(G_upper_c, determinant, invertible,
                                            kSmallestSine * g.l1_m * g.l2_m * g.l2_m);
    if (!invertible) {
      result.status = singular(m, 1);
      return result;
    }
    G_D_lower.computeInverseAndDetWithCheck(G_lower_D, determinant, invertible,
                                            kSmallestSine * g.l3_m * g.l4_m * g.l4_m);
    if (!invertible) {
      result.status = singular(m, 4);
      return result;
    }
    // Eq. 13, 14: first rows for the two motors; Eq. 15, 16: on to the twist.
    Eigen::Matrix<double, 2, 3> G_A_upper;
    G_A_upper << 1, 0, 0, (G_lower_D * G_D_upper).row(0);
    const Vector3d r = T_device_plate.q * leg::plate_joint(g, m);
    result.G.middleRows<2>(motor_index(m, 0)) =
        G_A_upper * G_upper_c * R_device_leg.transpose() * point_influence(r);
  }
  return result;
}

SingularRange singular_range(const Jacobian& G, double characteristic_length_m) noexcept {
  Jacobian scaled = G;
  scaled.rightCols<3>() /= characteristic_length_m;
  if (!scaled.allFinite()) return {};
  const Eigen::Matrix<double, 6, 6> normal = scaled.transpose() * scaled;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>> solver(normal,
                                                                          Eigen::EigenvaluesOnly);
  const SingularRange range = {std::sqrt(std::max(0.0, solver.eigenvalues()[0])),
                               std::sqrt(std::max(0.0, solver.eigenvalues()[5]))};
  if (solver.info() == Eigen::Success && range.smallest > kSmallestSquared * range.largest) {
    return range;
  }
  // Nearly 4 us more, which only a pose beside a singularity has to pay.
  const Eigen::JacobiSVD<Jacobian> svd(scaled);
  if (svd.info() != Eigen::Success) return {};
  return {svd.singularValues()[5], svd.singularValues()[0]};
}

double inverse_condition(const Jacobian& G, double characteristic_length_m) noexcept {
  const SingularRange range = singular_range(G, characteristic_length_m);
  return range.largest > 0 ? range.smallest / range.largest : 0;
}

TwistResult twist_from_motor_rates(const Jacobian& G, const MotorVector& motor_rad_per_s) noexcept {
  TwistResult result;
  Jacobian scaled = G;
  scaled.rightCols<3>() /= kCharacteristicLength_m;
  if (!scaled.allFinite() || !motor_rad_per_s.allFinite()) {
    result.status.failure = KinematicsFailure::kBadInput;
    return result;
  }
  const Eigen::HouseholderQR<Jacobian> qr(scaled);
  const auto diagonal = qr.matrixQR().diagonal().cwiseAbs();
  if (!(diagonal.minCoeff() > kSmallestRank * diagonal.maxCoeff())) {
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
