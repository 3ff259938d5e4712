// SPDX-License-Identifier: Apache-2.0
// Virtual coupling: a proxy of the tool is in contact with the sheets, and the device renders a spring and a
// damper between the plate and the proxy. However stiff a sheet is, the rendered stiffness is at most that of
// the spring. (J. Colgate, M. Stanley, J. Brown, Issues in the haptic display of tool use, IROS 1995;
// R. Adams, B. Hannaford, Stable haptic interaction with virtual environments, IEEE TRA 15(3), 1999)
//
// The proxy has no mass, and has the plate's orientation. In each tick it moves to the equilibrium of coupling
// and environment. The environment consists of the sheet, the friction of the shaft and the rims around the
// proxy's last position. Each is linear up to its limit: the sheet does not pull, and dry friction slides.
//
// Contract (tests/runtime/contact/virtual_coupling_test.cpp):
//  1. If nothing acts on the proxy, the proxy coincides with the tool, and the force is zero.
//  2. If the proxy is at rest in a sheet of stiffness k, or is pushed aside by a rim of stiffness k, the force
//     is that of the springs k and the coupling in series. In motion, a damper in the sheet or friction of the
//     shaft adds exactly its own force.
//  3. In the tick in which a sheet is punctured, the coupling already transmits only the remaining forces.
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
  double damper_N_per_m = 0;  ///< damping divided by the time of the last move
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
/// elements. If `punctured` (a sheet was punctured in this tick), the proxy jumps by the change of
/// `state.offset_m`. The moment is that of the environment.
Wrench coupling_wrench(const CouplingOptions& options, const Wrench& wrench_device,
                       const LocalEnvironment& environment, bool punctured,
                       CouplingState& state) noexcept;

}  // namespace trocar::runtime
