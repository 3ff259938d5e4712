// SPDX-License-Identifier: Apache-2.0
// Couples the tool of a bone volume to a device's plate: as stiff as the scene says, within what the device
// can hold without releasing energy to the hand.
//
// A wrench that is held for a tick T releases at most dx' K dx / 2 (cutting_law.h). A device's own damping
// absorbs this energy if B - K T / 2 has no negative eigenvalue (J. Colgate, G. Schenkel, Passivity of a
// class of sampled-data systems, J. Robotic Systems 14(1), 1997). B is the damping of the joints' viscous
// friction, G' b G. If B is too small, the law is evaluated at the pose predicted one tick ahead. With
// prediction no trial up to K T^2 / M = 0.5 released energy, where M is the mass of the plate
// (tests/runtime/bone_cutting/law/cutting_feel_test.cpp).
//
// Contract (tests/runtime/bone_cutting/contact/device_coupling_test.cpp):
//  1. The axis is rigid if the scene says so, or if the scene leaves the choice and everything that the
//     tool can meet is softer than the coupling.
//  2. `damping_share` is the largest factor of K for which the device's damping suffices.
//  3. With prediction, K is at most 0.5 M / T^2, in translation and rotation.
//  4. The coupling's largest force is the one that the device can render along the tool at its peak torques.
#pragma once

#include <string>

#include "formats/session/device_description.h"
#include "runtime/bone_cutting/material/bone_volume.h"

namespace trocar::runtime {

struct DeviceCoupling {
  CuttingCoupling coupling;
  bool predicts_pose = false;  ///< the law is evaluated at the pose predicted one tick ahead
  double damping_share = 0;    ///< at least 1: the device's own damping suffices
  double most_N = 0;  ///< largest force of the device along the tool, divided by the force scale
};

/// Chooses the coupling for a pose of the plate, such as the one with the tip on the bone's top.
DeviceCoupling choose_coupling(const BoneVolume& bone, const SceneForceLaw& law,
                               const DeviceDescription& device, const Pose& T_device_plate,
                               double rate_Hz);

/// The choice in one line, for `--check`.
std::string describe(const DeviceCoupling& chosen, const SceneForceLaw& law);

}  // namespace trocar::runtime
