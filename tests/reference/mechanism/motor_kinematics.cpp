// SPDX-License-Identifier: Apache-2.0
#include "tests/reference/mechanism/motor_kinematics.h"

#include <Eigen/Cholesky>
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

int sign(double x) noexcept {
  return (x > 0) - (x < 0);
}

MotorPoseStatus failure(MotorPoseFailure why, int leg, int joint) noexcept {
  return {why, leg + 1, joint};
}

// Returns kOk if the pose that the iteration found is on the description's branches, is near
// the last pose, and fits the angles.
MotorPoseStatus same_branch(const DeviceDescription& device, const MotorVector& motor_rad,
                            const Pose& T_last, const GaussNewtonOptions& options,
                            const MotorPose& found) noexcept {
  const DeviceGeometry& g = device.geometry;
  const Pose& T = found.T_device_plate;
  for (int m = 0; m < kLegs; ++m) {
    const Vector3d C = leg::to_leg(m, T * leg::plate_joint(g, m));
    const LegBranch branch =
        branch_of(g, C, motor_rad[motor_index(m, 0)], motor_rad[motor_index(m, 1)]);
    if (branch.theta1 != g.branch_theta1) return failure(MotorPoseFailure::kOtherBranch, m, 1);
    if (branch.theta4 != g.branch_theta4) return failure(MotorPoseFailure::kOtherBranch, m, 4);
  }
  const double travel_m =
      std::hypot((T.p_m - T_last.p_m).norm(),
                 kCharacteristicLength_m * rotation_vector(T.q * T_last.q.conjugate()).norm());
  if (!(travel_m <= options.travel_max_m) || !(found.residual_m <= options.residual_max_m)) {
    return {MotorPoseFailure::kOtherBranch, 0, 0};
  }
  return {};
}

}  // namespace

const char* to_string(MotorPoseFailure failure) noexcept {
  switch (failure) {
    case MotorPoseFailure::kOk:
      return to_string(KinematicsFailure::kOk);
    case MotorPoseFailure::kBadInput:
      return to_string(KinematicsFailure::kBadInput);
    case MotorPoseFailure::kSingular:
      return to_string(KinematicsFailure::kSingular);
    case MotorPoseFailure::kNotConverged:
      return "not converged";
    case MotorPoseFailure::kOtherBranch:
      return "on another branch of a leg";
  }
  return "unknown";
}

LegBranch branch_of(const DeviceGeometry& g, const Vector3d& C, double th1, double th4) noexcept {
  // A positive acos turns the motor's link ahead of the driven point, which makes the arm negative.
  const Vector3d E = leg::elbow(g, th1);
  const Vector3d upper = C - E, lower = leg::link_joint(g, E, C) - leg::lower_elbow(g, th4);
  return {-sign(upper.dot(g.l1_m * leg::upper_derivative(th1))),
          -sign(lower.dot(g.l3_m * leg::lower_derivative(th4)))};
}

MotorPose forward_kinematics_from_motors(const DeviceDescription& device,
                                         const MotorVector& motor_rad,
                                         const Pose& T_device_plate_last,
                                         const GaussNewtonOptions& options) noexcept {
  MotorPose result;
  const DeviceGeometry& g = device.geometry;
  if (!motor_rad.allFinite() || !is_good_pose(T_device_plate_last)) {
    result.status.failure = MotorPoseFailure::kBadInput;
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
  result.status.failure = MotorPoseFailure::kNotConverged;
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
        result.status = failure(MotorPoseFailure::kSingular, m, upper_m > lower_m ? 4 : 1);
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
      result.status.failure = MotorPoseFailure::kSingular;
      return result;
    }
    const double largest = step.cwiseAbs().maxCoeff();
    if (largest > kMaxStep_m) step *= kMaxStep_m / largest;
    T.p_m += step.head<3>();
    T.q = (from_rotation_vector(step.tail<3>() / kCharacteristicLength_m) * T.q).normalized();
    if (largest <= options.step_m) result.status.failure = MotorPoseFailure::kOk;
  }
  if (result.status) {
    result.status = same_branch(device, motor_rad, T_device_plate_last, options, result);
  }
  return result;
}

}  // namespace trocar::runtime
