// SPDX-License-Identifier: Apache-2.0
// Virtual coupling (J. Colgate, M. Stanley, J. Brown, Issues in the haptic display of tool use,
// IROS 1995; R. Adams, B. Hannaford, Stable haptic interaction with virtual environments, IEEE TRA
// 15(3), 1999): the sheets are met by a proxy of the tool, and spring and damper between the two
// are what the hand feels. However stiff a sheet, the device renders at most the spring.
//
// The proxy has no mass and the plate's orientation; it moves each tick to where coupling and
// environment balance, the environment taken as a spring and a damper from where the proxy last
// was.
//
// Laws (tests/runtime/control/virtual_coupling_test.cpp):
//  1. Where nothing acts on the proxy it is the tool, and no force is felt.
//  2. At rest in a sheet of stiffness k the force felt is that of k and the coupling in series; a
//     damper in the sheet adds its own share in motion, and nothing else.
//  3. A release of the environment is a release of the coupling, in the same tick.
#pragma once

#include "runtime/mechanism/pose.h"

namespace trocar::runtime {

struct CouplingOptions {
  bool on = false;
  double stiffness_N_per_m = 10000;
  double damping_N_s_per_m = 5;
};

/// What the proxy meets: along the force, stiffness times depth and damping times rate.
struct ProxyEnvironment {
  Wrench wrench_device = Wrench::Zero();
  double stiffness_N_per_m = 0, damping_N_s_per_m = 0;
  double rate_m_per_s = 0;  ///< of the depth
};

/// Between ticks.
struct CouplingState {
  bool has_last = false;
  Eigen::Vector3d device_m = Eigen::Vector3d::Zero();  ///< the plate's origin, last tick
  Eigen::Vector3d offset_m = Eigen::Vector3d::Zero();  ///< proxy less device
  Eigen::Vector3d last_offset_m = Eigen::Vector3d::Zero();
  ProxyEnvironment environment;
  double damper_N_per_m = 0;  ///< damping over the last move's time
};

/// The proxy in the place of the plate at a tick's start. `moved_over_s`: as in update_contact;
/// without a new pose the proxy stays too, and spring and damper act on as they did.
Pose move_proxy(const CouplingOptions& options, double moved_over_s, const Pose& T_device_plate,
                CouplingState& state) noexcept;

/// The wrench on the plate, given what the proxy meets. The moment is the environment's.
Wrench felt_wrench(const CouplingOptions& options, const ProxyEnvironment& environment,
                   CouplingState& state) noexcept;

}  // namespace trocar::runtime
