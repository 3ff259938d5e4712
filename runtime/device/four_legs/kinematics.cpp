// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/four_legs/kinematics.h"

#include <Eigen/QR>
#include <Eigen/SVD>

#include "runtime/device/symmetric_eigenvalues.h"

namespace trocar::runtime::leg {
namespace {

using Eigen::Vector3d;

constexpr double kTurn = 2 * std::numbers::pi;
// A chain counts as stretched or folded if the sine of the angle between its links is below this.
constexpr double kMinSine = 1e-6;

double wrapped_near(double angle, double centre) noexcept {
  return angle - kTurn * std::round((angle - centre) / kTurn);
}

double middle(const JointLimit& limit) noexcept {
  return (limit.min_rad + limit.max_rad) / 2;
}

// The angles of a chain of two links. The first link (length a) turns in the plane with coordinates
// (px, py). The second link (length b) may also leave this plane, by pn along its normal. `first`
// is the angle of the first joint, `second` the angle of the second joint relative to it, and
// `lift` the angle out of the plane.
struct ChainAngles {
  double first = 0, second = 0, lift = 0;
};
KinematicsFailure solve_chain(double px, double py, double pn, double a, double b, int branch,
                              ChainAngles& out, bool& lift_failed) noexcept {
  const double sine = pn / b;
  lift_failed = !(std::abs(sine) < 1);
  if (lift_failed) return KinematicsFailure::kOutOfReach;
  const double projected = b * std::sqrt((1 - sine) * (1 + sine));  // second link, projected
  const double span = std::hypot(px, py);
  if (span < kMinSpan_m) return KinematicsFailure::kSingular;
  const double cosine = (span * span + a * a - projected * projected) / (2 * a * span);
  if (!(std::abs(cosine) <= 1)) return KinematicsFailure::kOutOfReach;
  out.lift = std::asin(sine);
  out.first = std::atan2(py, px) + branch * std::acos(cosine);
  out.second = std::atan2(py - a * std::sin(out.first), px - a * std::cos(out.first)) - out.first;
  return KinematicsFailure::kOk;
}

// Lever arm of each motor's link on the link that it drives: the scalar product of that link
// and the motion per rad of the end of the motor's link. It is zero if the chain is
// stretched or folded.
struct Arms {
  Vector3d upper, lower;  // E to C, F to D
  Vector3d E_th1;         // dE / dth1
  double upper_arm_m2 = 0, lower_arm_m2 = 0;
};
Arms arms(const DeviceGeometry& g, const Vector3d& C, double th1, double th4) noexcept {
  Arms out;
  const Vector3d E = elbow(g, th1);
  out.upper = C - E;
  out.lower = link_joint(g, E, C) - lower_elbow(g, th4);
  out.E_th1 = g.l1_m * upper_derivative(th1);
  out.upper_arm_m2 = out.upper.dot(out.E_th1);
  out.lower_arm_m2 = out.lower.dot(g.l3_m * lower_derivative(th4));
  return out;
}

}  // namespace

KinematicsStatus inverse(const DeviceDescription& device, const Vector3d& C, LegBranch branch,
                         std::array<double, kJointsPerLeg>& theta) noexcept {
  const DeviceGeometry& g = device.geometry;
  ChainAngles angles;
  bool lift_failed = false;

  const Vector3d p = C - upper_motor(g);
  auto why = solve_chain(p.x(), p.z(), p.y(), g.l1_m, g.l2_m, branch.theta1, angles, lift_failed);
  if (why != KinematicsFailure::kOk) return {why, 0, lift_failed ? 3 : 1};
  theta[0] = angles.first;
  theta[1] = angles.second;
  theta[2] = angles.lift;

  const Vector3d D = link_joint(g, elbow(g, theta[0]), C);
  const Vector3d q = D - lower_motor(g);
  why = solve_chain(q.x(), q.y(), q.z(), g.l3_m, g.l4_m, branch.theta4, angles, lift_failed);
  if (why != KinematicsFailure::kOk) return {why, 0, lift_failed ? 6 : 4};
  theta[3] = angles.first;
  theta[4] = angles.second;
  theta[5] = angles.lift;

  for (std::size_t j = 0; j < kJointsPerLeg; ++j)
    theta[j] = wrapped_near(theta[j], middle(device.joint_limit[j]));
  return {};
}

KinematicsStatus motor_rates(const DeviceGeometry& g, const Vector3d& C, double th1, double th4,
                             Vector3d& w1, Vector3d& w4) noexcept {
  const Arms a = arms(g, C, th1, th4);
  if (!(std::abs(a.upper_arm_m2) > kMinSine * g.l1_m * g.l2_m))
    return {KinematicsFailure::kSingular, 0, 1};
  if (!(std::abs(a.lower_arm_m2) > kMinSine * g.l3_m * g.l4_m))
    return {KinematicsFailure::kSingular, 0, 4};
  // |C - E| = l2 implies th1' = w1 . C'. With D' = (1 - k) E_th1 th1' + k C', |D - F| = l4 implies
  // th4' = lower . D' / lower_arm.
  const double k = g.l5_m / g.l2_m;
  w1 = a.upper / a.upper_arm_m2;
  w4 = ((1 - k) * a.lower.dot(a.E_th1) * w1 + k * a.lower) / a.lower_arm_m2;
  return {};
}

}  // namespace trocar::runtime::leg

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;

constexpr double kUnitTolerance = 1e-9;  // allowed error of a unit quaternion's squared length

bool is_good_pose(const Pose& T) noexcept {
  return is_finite(T) && std::abs(T.q.squaredNorm() - 1) <= kUnitTolerance;
}

bool inside(const JointLimit& limit, double angle) noexcept {
  return angle >= limit.min_rad && angle <= limit.max_rad;  // false for NaN
}

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

const char* to_string(KinematicsFailure failure) noexcept {
  constexpr const char* kNames[] = {"none", "bad input", "out of reach", "singular",
                                    "beyond limit"};
  return kNames[static_cast<std::size_t>(failure)];
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
      if (!inside(device.joint_limit[j], encoder_rad[encoder_index(m, j)]))
        return {KinematicsFailure::kBeyondLimit, m + 1, j + 1};
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
  for (int m = 0; m < kLegs; ++m)
    sum += (C[m] - result.T_device_plate * leg::plate_joint(g, m)).squaredNorm();
  result.residual_m = std::sqrt(sum / kLegs);
  return result;
}

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
