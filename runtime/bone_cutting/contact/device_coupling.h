// SPDX-License-Identifier: Apache-2.0
// Chooses the coupling between the device's plate and the tool in the bone. The coupling is as stiff as the scene
// asks, but not stiffer than the device can render without releasing energy to the hand. If the scene states no
// stiffness, the coupling gets the largest one that is allowed.
//
// Let T be the duration of a tick, K the rendered stiffness, dx the displacement of the plate in a
// tick and dx^T its transpose. A wrench that is held for a tick releases at most dx^T K dx / 2
// (cutting_law.h, contract 1). Let B be the damping matrix that the device's own friction gives the
// plate (DeviceSpecification::damping()). The damping absorbs that energy if B - K T / 2 has no
// negative eigenvalue (J. Colgate, G. Schenkel, Passivity of a class of sampled-data systems, J.
// Robotic Systems 14(1), 1997). If B is too small, the law is evaluated at a pose that is predicted one
// tick ahead. Let M be the mass of the plate. With prediction, no simulation with K T^2 / M up to 0.5
// released energy (tests/runtime/bone_cutting/law/cutting_feel_test.cpp).
//
// Contract (tests/runtime/bone_cutting/contact/device_coupling_test.cpp):
//  1. If the scene says so, the tool is rigidly fixed to the plate, without a coupling spring. If the scene
//     leaves the choice open, the tool is rigid when the largest stiffness that it can meet in the bone is below
//     that of the coupling.
//  2. `damping_share` is the largest factor f for which B - f K T / 2 has no negative eigenvalue.
//  3. With prediction, the stiffness of the coupling spring is at most 0.5 M / T^2, divided by the force scale
//     (SceneForceLaw::force_scale) and by StiffnessLimits::margin. The limit in rotation is the same with the
//     plate's smallest moment of inertia in place of M. A stiffness of 0 in the scene's law selects this limit,
//     whether the pose is predicted or not. Whatever the scene says, the rendered stiffness at the tip never
//     exceeds the stiffness that the device states or the operator's limit. To stay within them, a tool that the
//     scene declares rigid gets a coupling.
//  4. `inertia_share` also includes the stiffness of a rigid tool, which is not limited.
//  5. The coupling's largest force is the one that the device can render along the tool at its peak torques,
//     divided by the force scale.
#pragma once

#include <string>

#include "runtime/bone_cutting/material/bone_volume.h"
#include "runtime/contact/force_law.h"
#include "runtime/device/hand_device.h"

namespace trocar::runtime {

/// The largest K T^2 / M for which the law was tested at a predicted pose.
inline constexpr double kMaxInertiaShare = 0.5;

struct DeviceCoupling {
  CuttingCoupling coupling;
  bool predicts_pose = false;  ///< the law is evaluated at the pose predicted one tick ahead
  double damping_share = 0;    ///< at least 1: the device's own damping suffices
  /// The rendered stiffness divided by M / T^2: the larger of the values for translation and for rotation. With
  /// prediction, values above inertia_limit are not known to be passive.
  double inertia_share = 0;
  double inertia_limit = kMaxInertiaShare;  ///< kMaxInertiaShare divided by StiffnessLimits::margin
  double most_N = 0;  ///< largest tissue force along the tool that the device can render
  /// The smaller of the stiffness that the device states and the operator's limit, divided by the force scale;
  /// infinite if neither is stated.
  double ceiling_N_per_m = 0;
  bool is_at_ceiling = false;  ///< the stiffness of the coupling is this limit
};

/// Chooses the coupling for one pose of the plate, for example with the tip on top of the bone.
DeviceCoupling choose_coupling(const BoneVolume& bone, const SceneForceLaw& law,
                               const DeviceSpecification& device, const Pose& T_device_plate,
                               double rate_Hz, const StiffnessLimits& limits = {});

/// Returns the choice as one line of text, for `--check`.
std::string describe(const DeviceCoupling& chosen, const SceneForceLaw& law);

/// Returns the reason why the loop may release energy to the hand or oscillate with this choice, and what helps.
/// Empty if there is no such reason.
std::string stability_warning(const DeviceCoupling& chosen);

}  // namespace trocar::runtime
