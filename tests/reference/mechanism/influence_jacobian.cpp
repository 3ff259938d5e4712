// SPDX-License-Identifier: Apache-2.0
#include "tests/reference/mechanism/influence_jacobian.h"

#include <Eigen/LU>
#include <cmath>

#include "runtime/device/four_legs/kinematics.h"

namespace trocar::runtime {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// A chain counts as stretched or folded below this sine of its angle.
constexpr double kMinSine = 1e-6;

KinematicsStatus singular(int leg, int joint) noexcept {
  return {KinematicsFailure::kSingular, static_cast<std::int8_t>(leg + 1),
          static_cast<std::int8_t>(joint)};
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
                                            kMinSine * g.l1_m * g.l2_m * g.l2_m);
    if (!invertible) {
      result.status = singular(m, 1);
      return result;
    }
    G_D_lower.computeInverseAndDetWithCheck(G_lower_D, determinant, invertible,
                                            kMinSine * g.l3_m * g.l4_m * g.l4_m);
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

}  // namespace trocar::runtime
