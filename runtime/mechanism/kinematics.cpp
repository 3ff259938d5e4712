// SPDX-License-Identifier: Apache-2.0
#include "runtime/mechanism/kinematics.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "runtime/mechanism/jacobian.h"
#include "runtime/mechanism/leg.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;

constexpr double kUnitTolerance = 1e-9;  // allowed error of a unit quaternion's squared length
constexpr double kMaxStep_m = 0.02;      // trust region of Gauss-Newton

bool is_good_pose(const Pose& T) noexcept {
  return is_finite(T) && std::abs(T.q.squaredNorm() - 1) <= kUnitTolerance;
}

bool inside(const JointLimit& limit, double angle) noexcept {
  return angle >= limit.min_rad && angle <= limit.max_rad;  // false for NaN
}

// Returns kOk if the pose that the iteration found is on the description's branches, is near
// the last pose, and fits the angles.
KinematicsStatus same_branch(const DeviceDescription& device, const MotorVector& motor_rad,
                             const Pose& T_last, const GaussNewtonOptions& options,
                             const ForwardResult& found) noexcept {
  const DeviceGeometry& g = device.geometry;
  const Pose& T = found.T_device_plate;
  for (int m = 0; m < kLegs; ++m) {
    const Vector3d C = leg::to_leg(m, T * leg::plate_joint(g, m));
    const LegBranch branch =
        leg::branch_of(g, C, motor_rad[motor_index(m, 0)], motor_rad[motor_index(m, 1)]);
    if (branch.theta1 != g.branch_theta1) return {KinematicsFailure::kOtherBranch, m + 1, 1};
    if (branch.theta4 != g.branch_theta4) return {KinematicsFailure::kOtherBranch, m + 1, 4};
  }
  const double travel_m =
      std::hypot((T.p_m - T_last.p_m).norm(),
                 kCharacteristicLength_m * rotation_vector(T.q * T_last.q.conjugate()).norm());
  if (!(travel_m <= options.travel_max_m) || !(found.residual_m <= options.residual_max_m)) {
    return {KinematicsFailure::kOtherBranch, 0, 0};
  }
  return {};
}

}  // namespace

const char* to_string(KinematicsFailure failure) noexcept {
  switch (failure) {
    case KinematicsFailure::kOk:
      return "none";
    case KinematicsFailure::kBadInput:
      return "bad input";
    case KinematicsFailure::kOutOfReach:
      return "out of reach";
    case KinematicsFailure::kSingular:
      return "singular";
    case KinematicsFailure::kBeyondLimit:
      return "beyond limit";
    case KinematicsFailure::kNotConverged:
      return "not converged";
    case KinematicsFailure::kOtherBranch:
      return "on another branch of a leg";
  }
  return "unknown";
}

MotorVector motor_angles(const JointAngles& joints) noexcept {
  return motor_angles(encoder_angles(joints));
}

std::array<double, kEncoders> encoder_angles(const JointAngles& joints) noexcept {
  std::array<double, kEncoders> encoder_rad{};
  for (int m = 0; m < kLegs; ++m) {
    for (int j = 0; j < 4; ++j)
      encoder_rad[encoder_index(m, j)] = joints.theta_rad[m][j];
  }
  return encoder_rad;
}

MotorVector motor_angles(const std::array<double, kEncoders>& encoder_rad) noexcept {
  MotorVector motor_rad;
  for (int m = 0; m < kLegs; ++m) {
    motor_rad[motor_index(m, 0)] = encoder_rad[encoder_index(m, 0)];
    motor_rad[motor_index(m, 1)] = encoder_rad[encoder_index(m, 3)];
  }
  return motor_rad;
}

InverseResult inverse_kinematics(const DeviceDescription& device,
                                 const Pose& T_device_plate) noexcept {
  InverseResult result;
  if (!is_good_pose(T_device_plate)) {
    result.status.failure = KinematicsFailure::kBadInput;
    return result;
  }
  const LegBranch branch{device.geometry.branch_theta1, device.geometry.branch_theta4};
  for (int m = 0; m < kLegs; ++m) {
    const Vector3d C = T_device_plate * leg::plate_joint(device.geometry, m);
    result.status = leg::inverse(device, leg::to_leg(m, C), branch, result.joints.theta_rad[m]);
    if (!result.status) {
      result.status.leg = m + 1;
      return result;
    }
  }
  return result;
}

KinematicsStatus check_joint_limits(const DeviceDescription& device,
                                    const std::array<double, kEncoders>& encoder_rad) noexcept {
  for (int m = 0; m < kLegs; ++m) {
    for (int j = 0; j < 4; ++j) {
      if (!inside(device.joint_limit[j], encoder_rad[encoder_index(m, j)])) {
        return {KinematicsFailure::kBeyondLimit, m + 1, j + 1};
      }
    }
  }
  return {};
}

ForwardResult forward_kinematics(const DeviceDescription& device,
                                 const std::array<double, kEncoders>& encoder_rad) noexcept {
  ForwardResult result;
  const DeviceGeometry& g = device.geometry;
  std::array<Vector3d, kLegs> C;
  for (int m = 0; m < kLegs; ++m) {
    const double* theta = &encoder_rad[encoder_index(m, 0)];
    C[m] = leg::from_leg(m, leg::upper_tip(g, theta[0], theta[1], theta[2]));
    if (!C[m].allFinite()) {
      result.status = {KinematicsFailure::kBadInput, m + 1, 0};
      return result;
    }
  }
  // On the plate the joints lie at +-R_T on its x and y axes. Hence the best position is the mean
  // of the C_m, and Kabsch's 3 x 3 correlation has rank two: columns R_T (C1 - C3), R_T (C2 - C4).
  // The best rotation's first two columns are the orthogonal polar factor of
  // M = [C1 - C3, C2 - C4], that is M (M^T M)^(-1/2). A 2 x 2 matrix S has the square root
  // (S + d I) / sqrt(tr S + 2 d) with d = sqrt(det S).
  Eigen::Matrix<double, 3, 2> M;
  M.col(0) = C[0] - C[2];
  M.col(1) = C[1] - C[3];
  const Eigen::Matrix2d S = M.transpose() * M;
  const double determinant = S.determinant();
  // If the determinant is smaller, the four points are almost on a line, about which the
  // rotation is undefined.
  if (!(determinant > 1e-6 * S(0, 0) * S(1, 1)) || !(S.trace() > 1e-4 * g.R_T_m * g.R_T_m)) {
    result.status.failure = KinematicsFailure::kSingular;
    return result;
  }
  const double d = std::sqrt(determinant);
  const Eigen::Matrix2d root = (S + d * Eigen::Matrix2d::Identity()) / std::sqrt(S.trace() + 2 * d);
  Eigen::Matrix3d R;
  R.leftCols<2>() = M * root.inverse();
  R.col(2) = R.col(0).cross(R.col(1));

  result.T_device_plate.p_m = (C[0] + C[1] + C[2] + C[3]) / 4;
  result.T_device_plate.q = Eigen::Quaterniond(R).normalized();
  double sum = 0;
  for (int m = 0; m < kLegs; ++m) {
    sum += (C[m] - result.T_device_plate * leg::plate_joint(g, m)).squaredNorm();
  }
  result.residual_m = std::sqrt(sum / kLegs);
  return result;
}

ForwardResult forward_kinematics_from_motors(const DeviceDescription& device,
                                             const MotorVector& motor_rad,
                                             const Pose& T_device_plate_last,
                                             const GaussNewtonOptions& options) noexcept {
  ForwardResult result;
  const DeviceGeometry& g = device.geometry;
  if (!motor_rad.allFinite() || !is_good_pose(T_device_plate_last)) {
    result.status.failure = KinematicsFailure::kBadInput;
    return result;
  }
  // The motor angles fix E and F, so the constraints are quadratic in C.
  std::array<Vector3d, kLegs> E, F;
  for (int m = 0; m < kLegs; ++m) {
    E[m] = leg::from_leg(m, leg::elbow(g, motor_rad[motor_index(m, 0)]));
    F[m] = leg::from_leg(m, leg::lower_elbow(g, motor_rad[motor_index(m, 1)]));
  }
  const double k = g.l5_m / g.l2_m;
  Pose& T = result.T_device_plate;
  T = T_device_plate_last;
  result.status.failure = KinematicsFailure::kNotConverged;
  for (result.iterations = 0; result.iterations <= options.max_iterations; ++result.iterations) {
    Eigen::Matrix<double, kMotors, 6> J;  // the columns of rotation are scaled to metres
    MotorVector error_m;
    for (int m = 0; m < kLegs; ++m) {
      const Vector3d r = T.q * leg::plate_joint(g, m);
      const Vector3d C = T.p_m + r;
      const Vector3d upper = C - E[m];
      const Vector3d lower = E[m] + k * upper - F[m];
      const double upper_m = upper.norm(), lower_m = lower.norm();
      if (!(upper_m > leg::kMinSpan_m) || !(lower_m > leg::kMinSpan_m)) {
        result.status = {KinematicsFailure::kSingular, m + 1, upper_m > lower_m ? 4 : 1};
        return result;
      }
      error_m[motor_index(m, 0)] = upper_m - g.l2_m;
      error_m[motor_index(m, 1)] = lower_m - g.l4_m;
      const Vector3d n_upper = upper / upper_m;
      const Vector3d n_lower = (k / lower_m) * lower;
      J.row(motor_index(m, 0)) << n_upper.transpose(),
          r.cross(n_upper).transpose() / kCharacteristicLength_m;
      J.row(motor_index(m, 1)) << n_lower.transpose(),
          r.cross(n_lower).transpose() / kCharacteristicLength_m;
    }
    result.residual_m = std::sqrt(error_m.squaredNorm() / kMotors);
    if (result.status || result.iterations == options.max_iterations) break;

    const Eigen::Matrix<double, 6, 6> normal = J.transpose() * J;
    const Eigen::LDLT<Eigen::Matrix<double, 6, 6>> ldlt(normal);
    Eigen::Matrix<double, 6, 1> step = ldlt.solve(-(J.transpose() * error_m));
    const double smallest_pivot = ldlt.vectorD().cwiseAbs().minCoeff();
    if (!step.allFinite() || !(smallest_pivot > 1e-12 * ldlt.vectorD().cwiseAbs().maxCoeff())) {
      result.status.failure = KinematicsFailure::kSingular;
      return result;
    }
    const double largest = step.cwiseAbs().maxCoeff();
    if (largest > kMaxStep_m) step *= kMaxStep_m / largest;
    T.p_m += step.head<3>();
    T.q = (from_rotation_vector(step.tail<3>() / kCharacteristicLength_m) * T.q).normalized();
    if (largest <= options.step_m) result.status.failure = KinematicsFailure::kOk;
  }
  if (result.status) {
    result.status = same_branch(device, motor_rad, T_device_plate_last, options, result);
  }
  return result;
}

}  // namespace trocar::runtime
