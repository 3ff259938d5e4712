// SPDX-License-Identifier: Apache-2.0
#include "runtime/mechanism/singularity.h"

#include <limits>

#include "runtime/mechanism/leg.h"

namespace trocar::runtime {

Singularity measure_singularity(const DeviceDescription& device, const Pose& T_device_plate,
                                const JointAngles& joints, const Jacobian& G) noexcept {
  Singularity out;
  const SingularRange range = singular_range(G);
  out.smallest_singular_value_per_m = range.smallest;
  out.inverse_condition = range.largest > 0 ? range.smallest / range.largest : 0;

  const DeviceGeometry& g = device.geometry;
  out.nearest_branch_m = std::numeric_limits<double>::infinity();
  const auto nearest = [&out](double distance_m, int leg, int joint) {
    if (distance_m >= out.nearest_branch_m) return;
    out.nearest_branch_m = distance_m;
    out.nearest_leg = static_cast<std::int8_t>(leg + 1);
    out.nearest_joint = static_cast<std::int8_t>(joint);
  };
  for (int m = 0; m < kLegs; ++m) {
    const Eigen::Vector3d C = leg::to_leg(m, T_device_plate * leg::plate_joint(g, m));
    const Eigen::Vector3d D = leg::link_joint(g, leg::elbow(g, joints.theta_rad[m][0]), C);
    const Eigen::Vector3d p = C - leg::upper_motor(g), q = D - leg::lower_motor(g);
    BranchDistance& distance = out.branch[m];
    distance.theta1_m = leg::branch_distance(p.x(), p.z(), p.y(), g.l1_m, g.l2_m);
    distance.theta4_m = leg::branch_distance(q.x(), q.y(), q.z(), g.l3_m, g.l4_m);
    nearest(distance.theta1_m, m, 1);
    nearest(distance.theta4_m, m, 4);
  }
  return out;
}

}  // namespace trocar::runtime
