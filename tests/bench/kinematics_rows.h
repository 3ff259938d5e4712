// SPDX-License-Identifier: Apache-2.0
// Speed and error of a tick's kinematics, from encoders to wrench.
#pragma once

#include <nlohmann/json.hpp>

#include "formats/session/device_description.h"

namespace trocar::test {

/// A row for each function: its largest error over random poses of the stated workspace, and the
/// median time of a call (a pass over all poses, divided by their number). Forward kinematics must
/// find the pose that the angles were computed from.
nlohmann::json kinematics_rows(const DeviceDescription& device, int poses);

}  // namespace trocar::test
