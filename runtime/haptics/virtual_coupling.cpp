// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/virtual_coupling.h"

#include <Eigen/LU>

namespace trocar::runtime {
namespace {

/// Linear model: after a further displacement m of the proxy the environment's force is force_N -
/// resistance * m.
struct LinearForce {
  Eigen::Vector3d force_N = Eigen::Vector3d::Zero();
  Eigen::Matrix3d resistance_N_per_m = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d damping_N_per_m = Eigen::Matrix3d::Zero();  ///< dampers' part of the resistance
};

/// Assumed states of the elements during the coming move. They are corrected by the move that
/// results from them.
struct Guess {
  bool in_sheet = false;
  bool inwards = false;  ///< the shaft moves inwards
  bool slides = false;   ///< dry friction slides
  friend bool operator==(const Guess&, const Guess&) = default;
};

/// Dampers resist the coming move only: their force of the last move does not persist.
LinearForce linear_force(const LocalEnvironment& e, double pose_interval_s,
                         const Guess& guess) noexcept {
  LinearForce out;
  if (guess.in_sheet) {
    out.force_N.z() += e.sheet_N;
    out.resistance_N_per_m(2, 2) += e.sheet_N_per_m + e.sheet_N_s_per_m / pose_interval_s;
    out.damping_N_per_m(2, 2) += e.sheet_N_s_per_m / pose_interval_s;
  }
  const double dry_N = guess.slides ? (guess.inwards ? e.dry_max_N : -e.dry_max_N) : e.dry_N;
  const double dry_N_per_m = guess.slides    ? 0
                             : guess.inwards ? e.dry_in_N_per_m
                                             : e.dry_out_N_per_m;
  const double along_N_per_m = dry_N_per_m + e.viscous_N_s_per_m / pose_interval_s;
  out.force_N += dry_N * e.axis;
  out.resistance_N_per_m.col(2) += along_N_per_m / e.axis.z() * e.axis;
  out.damping_N_per_m.col(2) += e.viscous_N_s_per_m / pose_interval_s / e.axis.z() * e.axis;
  out.force_N.head<2>() += e.rim_N;
  out.resistance_N_per_m.topLeftCorner<2, 2>() += e.rim_N_per_m * Eigen::Matrix2d::Identity();
  out.resistance_N_per_m.topRightCorner<2, 1>() -= e.rim_N_per_m / e.axis.z() * e.axis.head<2>();
  return out;
}

/// Returns the guess corrected by a move; it is unchanged if it was right. An element that has let go
/// does not take hold again, so that the corrections end.
Guess corrected(const LocalEnvironment& e, double pose_interval_s, const Eigen::Vector3d& move_m,
                const Eigen::Vector3d& noise_m, const Guess& guess) noexcept {
  Guess out = guess;
  const double sheet_N = e.sheet_N -
                         (e.sheet_N_per_m + e.sheet_N_s_per_m / pose_interval_s) * move_m.z() +
                         e.sheet_N_s_per_m / pose_interval_s * noise_m.z();
  out.in_sheet = guess.in_sheet && sheet_N >= 0;
  if (guess.slides) return out;
  const double inserted_m = -move_m.z() / e.axis.z();
  out.inwards = inserted_m > 0;
  const double dry_N = e.dry_N + (out.inwards ? e.dry_in_N_per_m : e.dry_out_N_per_m) * inserted_m;
  out.slides = std::abs(dry_N) > e.dry_max_N;
  return out;
}

constexpr int kMaxGuesses = 6;  // in_sheet, inwards and slides, each corrected twice

}  // namespace

Pose move_proxy(const CouplingOptions& options, double pose_interval_s, const Pose& T_device_plate,
                CouplingState& state, const PreviousPose& previous) noexcept {
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
  const LocalEnvironment& environment = state.environment;
  // Dampers of the environment use the velocity since `previous`; its springs use the displacement.
  const Eigen::Vector3d noise_m =
      previous.ago_s > 0
          ? Eigen::Vector3d(moved_m - (T_device_plate.p_m - previous.T_device_plate.p_m) *
                                          (pose_interval_s / previous.ago_s))
          : Eigen::Vector3d(Eigen::Vector3d::Zero());
  Guess guess{environment.sheet_N_per_m > 0, moved_m.z() < 0, false};
  for (int i = 0; i < kMaxGuesses; ++i) {
    const LinearForce force = linear_force(environment, pose_interval_s, guess);
    const double own_N_per_m = options.stiffness_N_per_m + state.damper_N_per_m;
    const Eigen::Matrix3d all_N_per_m =
        force.resistance_N_per_m + own_N_per_m * Eigen::Matrix3d::Identity();
    const Eigen::Vector3d right_N =
        force.force_N - force.resistance_N_per_m * (moved_m - state.last_offset_m) +
        state.damper_N_per_m * state.last_offset_m + force.damping_N_per_m * noise_m;
    state.offset_m = all_N_per_m.inverse() * right_N;
    const Eigen::Vector3d move_m = moved_m + state.offset_m - state.last_offset_m;
    const Guess next = corrected(environment, pose_interval_s, move_m, noise_m, guess);
    if (next == guess) break;
    guess = next;
  }
  proxy.p_m += state.offset_m;
  return proxy;
}

PreviousPose previous_proxy(double pose_interval_s, const PreviousPose& previous,
                            const CouplingState& state) noexcept {
  PreviousPose proxy = previous;
  if (!(pose_interval_s > 0) || !(previous.ago_s > 0)) return proxy;
  // The offset is in equilibrium with the sheet's force, so it has no more noise than that force. Its
  // rate is added to the plate's.
  proxy.T_device_plate.p_m +=
      state.offset_m - previous.ago_s / pose_interval_s * (state.offset_m - state.last_offset_m);
  return proxy;
}

Wrench coupling_wrench(const CouplingOptions& options, const Wrench& wrench_device,
                       const LocalEnvironment& environment, bool punctured,
                       CouplingState& state) noexcept {
  state.environment = environment;
  const Eigen::Vector3d force_N = wrench_device.head<3>();
  if (punctured || !(force_N.norm() > 0)) {
    state.offset_m = state.last_offset_m = force_N / options.stiffness_N_per_m;
    return wrench_device;
  }
  Wrench wrench = wrench_device;
  wrench.head<3>() = options.stiffness_N_per_m * state.offset_m +
                     state.damper_N_per_m * (state.offset_m - state.last_offset_m);
  return wrench;
}

}  // namespace trocar::runtime
