// SPDX-License-Identifier: Apache-2.0
// The built-in device with perfect encoders, for tests whose figures would show the resolution.
#pragma once

#include "formats/session/device_description.h"

namespace trocar::test {

inline DeviceDescription exact_device() {
  DeviceDescription device = default_device_description();
  device.encoder_counts_per_revolution = 0;
  return device;
}

}  // namespace trocar::test
