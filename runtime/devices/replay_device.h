// SPDX-License-Identifier: Apache-2.0
// Plays back a recording: each read() returns the device's state and status from the next row of
// the recording. ReplayDevice does this for the four-legged device, ReplayPoseDevice for a device
// that measures its own pose.
#pragma once

#include <span>

#include "formats/session/recording.h"
#include "runtime/device/device.h"
#include "runtime/device/pose_device.h"

namespace trocar::runtime {

/// Sets the device's state of a row, which the device had sent or measured in the row's tick.
inline void take_state(const RecordingRow& row, DeviceState& state) noexcept {
  state = {row.state_t_s, row.encoder_rad};
}
inline void take_state(const RecordingRow& row, PoseReading& reading) noexcept {
  reading = {row.state_t_s, row.pose_device.p_m, row.pose_device.q, row.pose_device.buttons};
}

/// `Interface` is Device or PoseDevice. `State` and `Command` are what its read() and write() take.
template <typename Interface, typename State, typename Command>
class RecordedDevice final : public Interface {
 public:
  /// `rows` must outlive the device.
  explicit RecordedDevice(std::span<const RecordingRow> rows) : rows_(rows) {}

  /// Returns the state and the status of the next row, or kEndOfData after the last row.
  DeviceStatus read(State& state) noexcept override {
    if (next_ == rows_.size()) return DeviceStatus::kEndOfData;
    const RecordingRow& row = rows_[next_++];
    if (row.device_read == DeviceStatus::kOk) take_state(row, state);
    return row.device_read;
  }
  DeviceStatus write(const Command&) noexcept override {
    return next_ == 0 ? DeviceStatus::kOk : rows_[next_ - 1].device_write;
  }

 private:
  std::span<const RecordingRow> rows_;
  std::size_t next_ = 0;
};
using ReplayDevice = RecordedDevice<Device, DeviceState, DeviceCommand>;
using ReplayPoseDevice = RecordedDevice<PoseDevice, PoseReading, HandleWrench>;

}  // namespace trocar::runtime
