// SPDX-License-Identifier: Apache-2.0
// Virtual coupling for the laws `hooke` and `network`: a proxy, which is a virtual copy of the
// tool, is in contact with the sheets, and the device renders a spring and a damper between the
// plate and the proxy. However stiff a sheet is, the rendered stiffness is at most that of the
// spring. (J. Colgate, M. Stanley, J. Brown, Issues in the haptic display of tool use, IROS 1995;
// R. Adams, B. Hannaford, Stable haptic interaction with virtual environments, IEEE TRA 15(3),
// 1999)
//
// The proxy has no mass, and has the plate's orientation. In each tick the proxy moves to the
// position where the force of the coupling and the forces of the environment balance. The
// environment consists of the sheet in contact, the friction on the shaft and the rims of the
// holes. Its elements are linearised at the position that the proxy had in the last tick. Each
// element is linear within its limits: the sheet cannot pull, and dry friction slides at its
// maximum.
//
// Contract (tests/runtime/haptics/virtual_coupling_test.cpp):
//  1. If nothing acts on the proxy, the proxy coincides with the tool on the plate, and the
//     force is zero.
//  2. If the proxy rests in a sheet of stiffness k, or a rim of stiffness k pushes the proxy
//     aside, the force is that of two springs in series, k and the coupling. In motion, the forces
//     of the sheet's damper and of the shaft's friction are added in full.
//  3. In the tick in which a sheet is punctured, the coupling already transmits only the forces
//     that remain after the puncture.
#pragma once

#include "runtime/device/device.h"
#include "runtime/haptics/tool.h"

namespace trocar::runtime {

struct CouplingOptions {
  bool on = false;
  double stiffness_N_per_m = 10000;
  double damping_N_s_per_m = 5;
};

/// State kept between ticks.
struct CouplingState {
  bool has_last = false;
  Eigen::Vector3d device_m = Eigen::Vector3d::Zero();       ///< the plate's origin in the last tick
  Eigen::Vector3d offset_m = Eigen::Vector3d::Zero();       ///< proxy's origin minus plate's origin
  Eigen::Vector3d last_offset_m = Eigen::Vector3d::Zero();  ///< offset_m before the last move
  LocalEnvironment environment;  ///< elements at the proxy's last position
  double damper_N_per_m = 0;     ///< damping_N_s_per_m divided by the duration of the last move
};

/// Returns the pose of the proxy, which the caller uses instead of the plate's pose in this tick.
/// `pose_interval_s`, `previous`: as for update_contact() (puncture.h). In a tick without a new
/// pose the proxy keeps its offset from the plate, and spring and damper keep their forces.
Pose move_proxy(const CouplingOptions& options, double pose_interval_s, const Pose& T_device_plate,
                CouplingState& state, const PreviousPose& previous = {}) noexcept;

/// Converts the plate's PreviousPose to that of the proxy. Call this after move_proxy().
PreviousPose previous_proxy(double pose_interval_s, const PreviousPose& previous,
                            const CouplingState& state) noexcept;

/// Returns the wrench on the plate. `wrench_device`: wrench of the environment on the proxy.
/// `environment`: the elements whose forces add up to this wrench. `punctured`: a sheet was
/// punctured in this tick. In the tick of a puncture, or if no force acts, the function sets
/// `state.offset_m` to the offset at rest under the environment's force, so the proxy jumps. The
/// moment on the plate is the moment of the environment.
Wrench coupling_wrench(const CouplingOptions& options, const Wrench& wrench_device,
                       const LocalEnvironment& environment, bool punctured,
                       CouplingState& state) noexcept;

}  // namespace trocar::runtime
