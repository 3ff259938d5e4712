// SPDX-License-Identifier: Apache-2.0
// Virtual coupling: a proxy of the tool is in contact with the sheets, and the device renders a spring and a
// damper between the plate and the proxy. However stiff a sheet is, the rendered stiffness is at most that of
// the spring. (J. Colgate, M. Stanley, J. Brown, Issues in the haptic display of tool use, IROS 1995;
// R. Adams, B. Hannaford, Stable haptic interaction with virtual environments, IEEE TRA 15(3), 1999)
//
// The proxy has no mass, and has the plate's orientation. In each tick it moves to the position where the
// forces of the coupling and of its environment balance. The environment consists of the sheet, the friction
// of the shaft and the rims, all at the proxy's last position. Each of them is linear within its limits: the
// sheet cannot pull, and dry friction slides at its maximum.
//
// Contract (tests/runtime/contact/virtual_coupling_test.cpp):
//  1. If nothing acts on the proxy, the proxy coincides with the tool, and the force is zero.
//  2. If the proxy is at rest in a sheet of stiffness k, or is pushed aside by a rim of stiffness k, the force
//     is that of two springs in series, k and the coupling. In motion, the force of a damper in the sheet or
//     of the shaft's friction is added in full.
//  3. In the tick in which a sheet is punctured, the coupling already transmits only the forces that
//     remain after it.
#pragma once

#include "runtime/contact/local_environment.h"
#include "runtime/device/pose.h"

namespace trocar::runtime {

struct CouplingOptions {
  bool on = false;
  double stiffness_N_per_m = 10000;
  double damping_N_s_per_m = 5;
};

/// State kept between ticks.
struct CouplingState {
  bool has_last = false;
  Eigen::Vector3d device_m = Eigen::Vector3d::Zero();  ///< the plate's origin in the last tick
  Eigen::Vector3d offset_m = Eigen::Vector3d::Zero();  ///< proxy's origin minus plate's origin
  Eigen::Vector3d last_offset_m = Eigen::Vector3d::Zero();
  LocalEnvironment environment;
  double damper_N_per_m = 0;  ///< damping divided by the duration of the last move
};

/// Returns the pose of the proxy, to be used instead of the plate's in this tick. `pose_interval_s`,
/// `previous`: as for update_contact(). Without a new pose the proxy keeps its offset, and spring and damper
/// keep their forces.
Pose move_proxy(const CouplingOptions& options, double pose_interval_s, const Pose& T_device_plate,
                CouplingState& state, const PreviousPose& previous = {}) noexcept;

/// Returns the proxy's PreviousPose, given the plate's. Call it after move_proxy().
PreviousPose previous_proxy(double pose_interval_s, const PreviousPose& previous,
                            const CouplingState& state) noexcept;

/// Returns the wrench on the plate, given the wrench of the environment on the proxy and the environment's
/// elements. If a sheet was punctured in this tick (`punctured`), the proxy jumps by the change of
/// `state.offset_m`. The moment on the plate is the moment of the environment.
Wrench coupling_wrench(const CouplingOptions& options, const Wrench& wrench_device,
                       const LocalEnvironment& environment, bool punctured,
                       CouplingState& state) noexcept;

}  // namespace trocar::runtime
