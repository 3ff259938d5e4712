// SPDX-License-Identifier: Apache-2.0
// A device that is where one says, and keeps what it is told.
#pragma once

#include "runtime/device/device.h"

namespace trocar::test {

using runtime::DeviceCommand;
using runtime::DeviceState;

/// At encoder angles that are set.
class SetDevice final : public runtime::Device {
 public:
  DeviceStatus read(DeviceState& state) noexcept override {
    if (answer == DeviceStatus::kOk) state = now;
    return answer;
  }
  DeviceStatus write(const DeviceCommand& command) noexcept override {
    written = command;
    return DeviceStatus::kOk;
  }
  DeviceState now;
  DeviceStatus answer = DeviceStatus::kOk;  ///< to being read
  DeviceCommand written;
};

}  // namespace trocar::test
