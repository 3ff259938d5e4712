// SPDX-License-Identifier: Apache-2.0
// A recording in the place of a device: its encoders, tick by tick.
#pragma once

#include <span>

#include "formats/recording.h"
#include "runtime/device/device.h"

namespace trocar::runtime {

class ReplayDevice final : public Device {
 public:
  /// `rows` must outlive the device.
  explicit ReplayDevice(std::span<const RecordingRow> rows) : rows_(rows) {}

  /// The next row's; kEndOfData after the last.
  DeviceStatus read(DeviceState& state) noexcept override {
    if (next_ == rows_.size()) return DeviceStatus::kEndOfData;
    const RecordingRow& row = rows_[next_++];
    state.t_s = row.t_s;
    state.encoder_rad = row.encoder_rad;
    return DeviceStatus::kOk;
  }
  DeviceStatus write(const DeviceCommand&) noexcept override { return DeviceStatus::kOk; }

 private:
  std::span<const RecordingRow> rows_;
  std::size_t next_ = 0;
};

}  // namespace trocar::runtime
