// SPDX-License-Identifier: Apache-2.0
// Kinematics, speed against error: what a tick computes between encoders and wrench.
#pragma once

#include <nlohmann/json.hpp>

#include "formats/session/device_description.h"

namespace trocar::test {

/// A row a function: its largest error over random poses of the stated workspace, and the median
/// time of a call (of a pass over all of the poses). Forward kinematics must find the pose that the
/// angles were made from.
nlohmann::json kinematics_rows(const DeviceDescription& device, int poses);

}  // namespace trocar::test
