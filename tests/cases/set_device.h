// SPDX-License-Identifier: Apache-2.0
// A device whose state and status a test sets, and which stores the last command.
#pragma once

#include "runtime/device/device.h"

namespace trocar::test {

using runtime::DeviceCommand;
using runtime::DeviceState;

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
  DeviceStatus answer = DeviceStatus::kOk;  ///< returned by read()
  DeviceCommand written;
};

}  // namespace trocar::test
