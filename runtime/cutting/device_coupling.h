// SPDX-License-Identifier: Apache-2.0
// How the tool of a body hangs on the plate of a device: as stiff as the scene says, within what
// the device can hold without giving energy to the hand.
//
// A wrench that is held for a tick T gives at most dx' K dx / 2 (cutting_law.h). A device's own
// damping takes that if B - K T / 2 has no negative eigenvalue (J. Colgate, G. Schenkel, Passivity
// of a class of sampled-data systems, J. Robotic Systems 14(1), 1997). B is that of the joints'
// viscous friction, G' b G. Where it is too small the law is evaluated at the pose a tick ahead;
// nothing was given so in all trials up to K T^2 / M = 0.5, M the mass of the plate
// (tests/runtime/cutting/cutting_feel_test.cpp).
//
// Contract (tests/runtime/cutting/device_coupling_test.cpp):
//  1. The axis is rigid if the scene says so, or if it leaves the choice and all that the tool can
//     meet is softer than the coupling.
//  2. `damping_share` is the largest factor of K for which the device's damping suffices.
//  3. With a prediction K is at most 0.5 M / T^2, in translation and rotation.
//  4. The coupling's largest force is what the device can give along the tool at its peak torques.
#pragma once

#include <string>

#include "formats/session/device_description.h"
#include "runtime/cutting/body.h"

namespace trocar::runtime {

struct DeviceCoupling {
  CuttingCoupling coupling;
  bool predicts = false;
  double damping_share = 0;  ///< at least 1: the device's own damping suffices
  double most_N = 0;         ///< of the device along the tool; as for the coupling, not scaled
};

/// At a pose of the plate, such as that with the tip on the body's top.
DeviceCoupling choose_coupling(const Body& body, const ForceLaw& law,
                               const DeviceDescription& device, const Pose& T_device_plate,
                               double rate_Hz);

/// One line, such as: axis rigid; evaluated a tick ahead, since ...
std::string describe(const DeviceCoupling& chosen, const ForceLaw& law);

}  // namespace trocar::runtime
