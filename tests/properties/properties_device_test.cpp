// SPDX-License-Identifier: Apache-2.0
// The device has a four-fold symmetry: a pose rotated by a quarter turn about the device's axis
// gives each leg what the previous leg had. Values of one leg are equal to the bit; sums over all
// legs are equal up to rounding.
#include "runtime/device/four_legs/mechanism_limits.h"
#include "runtime/device/four_legs/torque_allocation.h"
#include "tests/properties/property_fixture.h"
#include "tests/reference/mechanism/leg_assemblies.h"
#include "tests/support/device_workspace.h"

namespace trocar::runtime {
namespace {

using testing_support::Random;
using testing_support::random_workspace_pose;

const DeviceDescription& device() {
  static const DeviceDescription made = default_device_description();
  return made;
}

Eigen::Vector3d rotated(const Eigen::Vector3d& v) {
  return {-v.y(), v.x(), v.z()};
}
// z (p, q) z^-1; exact, since z is a quarter turn.
Pose rotated(const Pose& T) {
  Pose out;
  out.p_m = rotated(T.p_m);
  out.q.w() = T.q.w();
  out.q.vec() = rotated(Eigen::Vector3d(T.q.vec()));
  return out;
}
Wrench rotated(const Wrench& wrench) {
  Wrench out;
  out << rotated(Eigen::Vector3d(wrench.head<3>())), rotated(Eigen::Vector3d(wrench.tail<3>()));
  return out;
}
/// The values of each leg moved to the next leg.
template <typename PerLeg>
PerLeg next_leg(const PerLeg& all) {
  PerLeg out = all;
  const auto each = static_cast<int>(all.size()) / kLegs;
  for (int i = 0; i < static_cast<int>(all.size()); ++i)
    out[(i + each) % static_cast<int>(all.size())] = all[i];
  return out;
}

// Half of them in the workspace, half anywhere, reachable or not.
Pose any_pose() {
  Random random(test::any_seed());
  testing_support::Workspace wide;
  wide.z_min_m = 0.02, wide.z_max_m = 0.3, wide.lateral_m = 0.1, wide.tilt_rad = 1;
  return *rc::gen::arbitrary<bool>() ? random_workspace_pose(random)
                                     : random_workspace_pose(random, wide);
}

RC_GTEST_PROP(Kinematics, IsSymmetricUnderAQuarterTurn, ()) {
  const Pose here = any_pose(), there = rotated(here);
  const InverseResult a = inverse_kinematics(device(), here),
                      b = inverse_kinematics(device(), there);
  RC_TAG(std::string(to_string(a.status.failure)));
  RC_ASSERT(static_cast<bool>(a.status) == static_cast<bool>(b.status));
  for (int leg = 0; leg < kLegs; ++leg) {
    const auto first = leg_assemblies(device(), here, leg),
               second = leg_assemblies(device(), there, (leg + 1) % kLegs);
    for (std::size_t k = 0; k < first.size(); ++k) {
      RC_ASSERT(first[k].status.failure == second[k].status.failure);
      RC_ASSERT(first[k].theta_rad == second[k].theta_rad);
    }
  }
  if (!a.status) return;
  // Sums over legs have another order.
  const auto encoders = encoder_angles(a.joints);
  const ForwardResult forward = forward_kinematics(device(), encoders),
                      forward_there = forward_kinematics(device(), next_leg(encoders));
  RC_ASSERT(static_cast<bool>(forward.status));
  RC_ASSERT(static_cast<bool>(forward_there.status));
  const Pose expected = rotated(forward.T_device_plate);
  RC_ASSERT((forward_there.T_device_plate.p_m - expected.p_m).norm() < 1e-14);
  RC_ASSERT(forward_there.T_device_plate.q.angularDistance(expected.q) < 1e-13);
}

RC_GTEST_PROP(Jacobian, IsSymmetricUnderAQuarterTurn, ()) {
  Random random(test::any_seed());
  const Pose here = random_workspace_pose(random), there = rotated(here);
  const InverseResult a = inverse_kinematics(device(), here),
                      b = inverse_kinematics(device(), there);
  const JacobianResult G = jacobian(device(), here, a.joints),
                       G_there = jacobian(device(), there, b.joints);
  RC_ASSERT(static_cast<bool>(G.status));
  RC_ASSERT(static_cast<bool>(G_there.status));
  for (int motor = 0; motor < kMotors; ++motor) {
    const Wrench row = G.G.row(motor).transpose();
    const Wrench row_there = G_there.G.row((motor + 2) % kMotors).transpose();
    RC_ASSERT(rotated(row) == row_there);
  }
  const Singularity s = measure_singularity(device(), here, a.joints, G.G),
                    s_there = measure_singularity(device(), there, b.joints, G_there.G);
  RC_ASSERT(std::abs(s.inverse_condition - s_there.inverse_condition) < 1e-9);
  RC_ASSERT(std::abs(s.nearest_branch_m - s_there.nearest_branch_m) < 1e-12);
}

RC_GTEST_PROP(Allocation, IsSymmetricUnderAQuarterTurn, ()) {
  Random random(test::any_seed());
  const Pose here = random_workspace_pose(random);
  const InverseResult a = inverse_kinematics(device(), here);
  const Jacobian G = jacobian(device(), here, a.joints).G;
  Jacobian G_there;
  MotorVector limit, limit_there;
  for (int motor = 0; motor < kMotors; ++motor) {
    const Wrench row = G.row(motor).transpose();
    G_there.row((motor + 2) % kMotors) = rotated(row).transpose();
    limit[motor] = random.between(2, 6);
    limit_there[(motor + 2) % kMotors] = limit[motor];
  }
  Wrench wanted;
  wanted << random.between(1, 150) * random.direction(), random.between(0, 2) * random.direction();
  const AllocationResult one = allocate_torques(G, wanted, limit),
                         other = allocate_torques(G_there, rotated(wanted), limit_there);
  RC_TAG(static_cast<int>(one.kind));
  RC_ASSERT(one.kind == other.kind);
  RC_ASSERT(std::abs(one.scale - other.scale) < 1e-12);
  RC_ASSERT((next_leg(one.tau_motor_Nm) - other.tau_motor_Nm).norm() < 1e-9);
}

}  // namespace
}  // namespace trocar::runtime
