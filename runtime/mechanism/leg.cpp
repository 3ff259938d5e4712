// SPDX-License-Identifier: Apache-2.0
#include "runtime/mechanism/leg.h"

#include <algorithm>
#include <numbers>

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

int sign(double x) noexcept {
  return (x > 0) - (x < 0);
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

  for (std::size_t j = 0; j < kJointsPerLeg; ++j) {
    theta[j] = wrapped_near(theta[j], middle(device.joint_limit[j]));
  }
  return {};
}

LegBranch branch_of(const DeviceGeometry& g, const Vector3d& C, double th1, double th4) noexcept {
  // A positive acos turns the motor's link ahead of the driven point, which makes the arm negative.
  const Arms a = arms(g, C, th1, th4);
  return {-sign(a.upper_arm_m2), -sign(a.lower_arm_m2)};
}

KinematicsStatus motor_rates(const DeviceGeometry& g, const Vector3d& C, double th1, double th4,
                             Vector3d& w1, Vector3d& w4) noexcept {
  const Arms a = arms(g, C, th1, th4);
  if (!(std::abs(a.upper_arm_m2) > kMinSine * g.l1_m * g.l2_m)) {
    return {KinematicsFailure::kSingular, 0, 1};
  }
  if (!(std::abs(a.lower_arm_m2) > kMinSine * g.l3_m * g.l4_m)) {
    return {KinematicsFailure::kSingular, 0, 4};
  }
  // |C - E| = l2 implies th1' = w1 . C'. With D' = (1 - k) E_th1 th1' + k C', |D - F| = l4 implies
  // th4' = lower . D' / lower_arm.
  const double k = g.l5_m / g.l2_m;
  w1 = a.upper / a.upper_arm_m2;
  w4 = ((1 - k) * a.lower.dot(a.E_th1) * w1 + k * a.lower) / a.lower_arm_m2;
  return {};
}

}  // namespace trocar::runtime::leg
