// SPDX-License-Identifier: Apache-2.0
#include "runtime/control/virtual_coupling.h"

namespace trocar::runtime {

Pose move_proxy(const CouplingOptions& options, double pose_interval_s, const Pose& T_device_plate,
                CouplingState& state, const EarlierPose& earlier) noexcept {
  Pose proxy = T_device_plate;
  if (!(pose_interval_s > 0)) {
    proxy.p_m += state.offset_m;
    return proxy;
  }
  const Eigen::Vector3d moved_m = state.has_last
                                      ? Eigen::Vector3d(T_device_plate.p_m - state.device_m)
                                      : Eigen::Vector3d(Eigen::Vector3d::Zero());
  state.has_last = true;
  state.damper_N_per_m = options.damping_N_s_per_m / pose_interval_s;
  state.device_m = T_device_plate.p_m;
  state.last_offset_m = state.offset_m;
  const ProxyEnvironment& environment = state.environment;
  const Eigen::Vector3d last_N = environment.wrench_device.head<3>();
  if (const double force_N = last_N.norm(); force_N > 0) {
    // Along its force the environment yields with its stiffness and damping; the damping force of
    // the last move does not persist. Across the force the environment gives no resistance.
    const Eigen::Vector3d n = last_N / force_N;
    const double d = state.damper_N_per_m;
    const double k =
        environment.stiffness_N_per_m + environment.damping_N_s_per_m / pose_interval_s;
    const double stays_N = force_N - environment.damping_N_s_per_m * environment.rate_m_per_s;
    const Eigen::Vector3d across =
        d / (options.stiffness_N_per_m + d) * (state.offset_m - n.dot(state.offset_m) * n);
    // The environment's damper takes its velocity from `earlier`, its spring the way moved.
    const Eigen::Vector3d noise_m =
        earlier.ago_s > 0
            ? Eigen::Vector3d(moved_m - (T_device_plate.p_m - earlier.T_device_plate.p_m) *
                                            (pose_interval_s / earlier.ago_s))
            : Eigen::Vector3d(Eigen::Vector3d::Zero());
    const double noise_N = environment.damping_N_s_per_m / pose_interval_s * n.dot(noise_m);
    const double along =
        (stays_N + noise_N - k * n.dot(moved_m) + (k + d) * n.dot(state.offset_m)) /
        (k + options.stiffness_N_per_m + d);
    state.offset_m = across + along * n;
  } else {
    state.offset_m.setZero();
  }
  proxy.p_m += state.offset_m;
  return proxy;
}

EarlierPose earlier_proxy(double pose_interval_s, const EarlierPose& earlier,
                          const CouplingState& state) noexcept {
  EarlierPose proxy = earlier;
  if (!(pose_interval_s > 0) || !(earlier.ago_s > 0)) return proxy;
  // The offset is in equilibrium with the sheet's force: it has no more noise than that, and its
  // own rate is added to the plate's.
  proxy.T_device_plate.p_m +=
      state.offset_m - earlier.ago_s / pose_interval_s * (state.offset_m - state.last_offset_m);
  return proxy;
}

Wrench coupling_wrench(const CouplingOptions& options, const ProxyEnvironment& environment,
                       CouplingState& state) noexcept {
  state.environment = environment;
  const double force_N = environment.wrench_device.head<3>().norm();
  if (!(force_N > 0)) {
    state.offset_m.setZero();
    return environment.wrench_device;
  }
  const Eigen::Vector3d n = environment.wrench_device.head<3>() / force_N;
  Eigen::Vector3d rendered_N = options.stiffness_N_per_m * state.offset_m +
                               state.damper_N_per_m * (state.offset_m - state.last_offset_m);
  const double pull_N = n.dot(rendered_N);
  if (pull_N < 0) rendered_N -= pull_N * n;  // the damper must not pull the tool into the sheet
  Wrench wrench = environment.wrench_device;
  wrench.head<3>() = rendered_N;
  return wrench;
}

}  // namespace trocar::runtime
