// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/simulated/mechanics.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;
using Row = Eigen::Matrix<double, 1, 6>;
using PointJacobian = Eigen::Matrix<double, 3, 6>;

/// Returns the Jacobian of a point of the plate at r, whose velocity is p' = v + omega x r.
PointJacobian rigid_point(const Vector3d& r) noexcept {
  PointJacobian J;
  J << 1, 0, 0, 0, r.z(), -r.y(),  //
      0, 1, 0, -r.z(), 0, r.x(),   //
      0, 0, 1, r.y(), -r.x(), 0;
  return J;
}

/// Adds up the equation of motion.
class Sum {
 public:
  Sum(Mechanics& result, double gravity_m_per_s2) : result_(result), gravity_(gravity_m_per_s2) {}
  /// Adds a point of mass m with Jacobian J and acceleration a at V' = 0.
  void add(double m, const PointJacobian& J, const Vector3d& a, bool has_weight = true) noexcept {
    if (m == 0) return;
    result_.mass.noalias() += m * J.transpose() * J;
    result_.bias.noalias() += m * J.transpose() * a;
    if (has_weight) result_.weight -= m * gravity_ * J.row(2).transpose();
  }
  void add_joint(double inertia, const Row& row, double acceleration) noexcept {
    result_.mass.noalias() += inertia * row.transpose() * row;
    result_.bias.noalias() += inertia * acceleration * row.transpose();
  }

 private:
  Mechanics& result_;
  double gravity_;
};

void add_plate(const DeviceDescription& device, const Pose& T, const Twist& twist,
               Mechanics& result) noexcept {
  const Eigen::Matrix3d R = T.q.toRotationMatrix();
  const Vector3d principal(device.plate_inertia_kg_m2.data());
  const Eigen::Matrix3d inertia = R * principal.asDiagonal() * R.transpose();
  const Vector3d omega = twist.tail<3>();
  result.mass.topLeftCorner<3, 3>().diagonal().setConstant(device.plate_mass_kg);
  result.mass.bottomRightCorner<3, 3>() = inertia;
  result.bias.tail<3>() = omega.cross(inertia * omega);
  result.weight[2] = -device.plate_mass_kg * device.gravity_m_per_s2;
}

/// Adds the point masses and rotors of one leg. Points, velocities and accelerations are in the
/// leg's frame.
void add_leg(const DeviceDescription& device, const MechanicsOptions& options, int m, const Pose& T,
             const JointAngles& joints, const Twist& twist, const Jacobian& G, Sum& sum) noexcept {
  const DeviceGeometry& g = device.geometry;
  const double k = g.l5_m / g.l2_m;
  const double th1 = joints.theta_rad[m][0], th4 = joints.theta_rad[m][3];
  const Row row1 = G.row(motor_index(m, 0)), row4 = G.row(motor_index(m, 1));
  const double rate1 = row1 * twist, rate4 = row4 * twist;
  const Vector3d r = T.q * leg::plate_joint(g, m), omega = twist.tail<3>();
  const Vector3d C_rate = leg::to_leg(m, Vector3d(twist.head<3>()) + omega.cross(r));
  const Vector3d C_second = leg::to_leg(m, omega.cross(omega.cross(r)));

  // Differentiating |C - E|^2 = l2^2 twice gives th1''; then |D - F|^2 = l4^2 gives th4''.
  const Vector3d C = leg::to_leg(m, T.p_m + r), E = leg::elbow(g, th1);
  const Vector3d upper = C - E, E_th1 = g.l1_m * leg::upper_derivative(th1);
  const Vector3d E_centre = -g.l1_m * rate1 * rate1 * leg::upper_direction(th1);
  const Vector3d E_rate = rate1 * E_th1;
  const double second1 =
      (upper.dot(C_second - E_centre) + (C_rate - E_rate).squaredNorm()) / upper.dot(E_th1);
  const Vector3d E_second = second1 * E_th1 + E_centre;

  const Vector3d lower = leg::link_joint(g, E, C) - leg::lower_elbow(g, th4);
  const Vector3d F_th4 = g.l3_m * leg::lower_derivative(th4);
  const Vector3d F_centre = -g.l3_m * rate4 * rate4 * leg::lower_direction(th4);
  const Vector3d D_rate = (1 - k) * E_rate + k * C_rate, F_rate = rate4 * F_th4;
  const Vector3d D_second = (1 - k) * E_second + k * C_second;
  const double second4 =
      (lower.dot(D_second - F_centre) + (D_rate - F_rate).squaredNorm()) / lower.dot(F_th4);
  const Vector3d F_second = second4 * F_th4 + F_centre;

  const PointJacobian J_C = rigid_point(r);
  const PointJacobian J_E = leg::from_leg(m, E_th1) * row1;
  const PointJacobian J_F = leg::from_leg(m, F_th4) * row4;
  const PointJacobian J_D = (1 - k) * J_E + k * J_C;
  const auto& mass = options.link_mass_kg;
  sum.add((mass[0] + mass[1]) / 2, J_E, leg::from_leg(m, E_second));
  sum.add(mass[1] / 2, J_C, leg::from_leg(m, C_second));
  sum.add((mass[2] + mass[3]) / 2, J_F, leg::from_leg(m, F_second));
  sum.add(mass[3] / 2, J_D, leg::from_leg(m, D_second));
  sum.add_joint(options.rotor_inertia_kg_m2, row1, second1);
  sum.add_joint(options.rotor_inertia_kg_m2, row4, second4);
}

}  // namespace

Mechanics mechanics(const DeviceDescription& device, const MechanicsOptions& options,
                    const Pose& T_device_plate, const JointAngles& joints,
                    const Twist& twist_device, double tip_mass_kg,
                    const Vector3d& lever_m) noexcept {
  Mechanics result;
  const JacobianResult motion = jacobian(device, T_device_plate, joints);
  result.status = motion.status;
  if (!motion.status) return result;
  result.G = motion.G;
  add_plate(device, T_device_plate, twist_device, result);
  Sum sum(result, device.gravity_m_per_s2);
  for (int m = 0; m < kLegs; ++m)
    add_leg(device, options, m, T_device_plate, joints, twist_device, motion.G, sum);
  const Vector3d omega = twist_device.tail<3>();
  sum.add(tip_mass_kg, rigid_point(lever_m), omega.cross(omega.cross(lever_m)), false);
  return result;
}

}  // namespace trocar::runtime
