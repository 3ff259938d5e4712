// SPDX-License-Identifier: Apache-2.0
// Plays back a recording of the four-legged device: each read() returns the device's state and
// status from the next row of the recording.
// Tests: tests/runtime/session/puncture_experiment_test.cpp
#pragma once

#include <span>

#include "formats/session/recording.h"
#include "runtime/device/device.h"

namespace trocar::runtime {

class ReplayDevice final : public Device {
 public:
  /// `rows` must outlive the device.
  explicit ReplayDevice(std::span<const RecordingRow> rows) : rows_(rows) {}

  /// Returns the state and the status of the next row, or kEndOfData after the last row.
  DeviceStatus read(DeviceState& state) noexcept override {
    if (next_ == rows_.size()) return DeviceStatus::kEndOfData;
    const RecordingRow& row = rows_[next_++];
    if (row.device_read != DeviceStatus::kOk) return row.device_read;
    state.t_s = row.state_t_s;
    state.encoder_rad = row.encoder_rad;
    return DeviceStatus::kOk;
  }
  DeviceStatus write(const DeviceCommand&) noexcept override {
    return next_ == 0 ? DeviceStatus::kOk : rows_[next_ - 1].device_write;
  }

 private:
  std::span<const RecordingRow> rows_;
  std::size_t next_ = 0;
};

}  // namespace trocar::runtime
