// SPDX-License-Identifier: Apache-2.0
// Which stops are held, from the rows of a session in order. There are four: the device's own
// emergency stop, and the operator's commands emergency stop, pause and zero forces. The loop and
// the readers of recordings share this rule, so they count the same presses.
#pragma once

#include "formats/session/recording.h"

namespace trocar {

/// True for the faults that stops raise. A failed check raises the others.
constexpr bool is_stop(Fault fault) noexcept {
  return fault == Fault::kEmergencyStop || fault == Fault::kPaused || fault == Fault::kForcesOff;
}

class HeldStops {
 public:
  /// Takes a tick's inputs: the status of its read, and RecordingRow::outside_fault. A read without
  /// data, or of a lost link, says nothing about the device's stop: it stays as it was. Returns true
  /// if an emergency stop, the device's or the operator's, is newly pressed.
  bool take(DeviceStatus read, Fault outside) noexcept {
    const bool device_was = device_, operator_was = outside_ == Fault::kEmergencyStop;
    if (read != DeviceStatus::kNoData && read != DeviceStatus::kLinkLost)
      device_ = read == DeviceStatus::kEmergencyStop || is_told_by_write_;
    is_released_now_ = device_was && !device_;
    outside_ = outside;
    return (device_ && !device_was) || (outside == Fault::kEmergencyStop && !operator_was);
  }
  /// Takes the status of the tick's write, after take(). Returns true as take() does.
  bool take_write(DeviceStatus written) noexcept {
    is_told_by_write_ = written == DeviceStatus::kEmergencyStop;
    const bool was = device_;
    device_ |= is_told_by_write_;
    return device_ && !was;
  }
  /// take() and take_write() of a recorded row.
  bool take(const RecordingRow& row) noexcept {
    const bool is_pressed = take(row.device_read, row.outside_fault);
    return take_write(row.device_write) || is_pressed;
  }

  bool is_device_held() const noexcept { return device_; }
  bool any() const noexcept { return device_ || is_stop(outside_); }
  /// A request for recovery seen in this tick is not newer than the release of every stop.
  bool refuse_recovery() const noexcept { return any() || is_released_now_; }

 private:
  bool device_ = false, is_told_by_write_ = false, is_released_now_ = false;
  Fault outside_ = Fault::kNone;
};

/// Finds the rows in which a fault begins, from the rows of a session in order.
class FaultStarts {
 public:
  /// Returns true if a fault was latched in this row. A stop that is pressed again while an
  /// emergency stop is latched is a new fault, although RecordingRow::fault does not change.
  bool take(const RecordingRow& row) noexcept {
    const bool is_pressed = stops_.take(row);
    const bool is_back = safety_ == SafetyState::kRecovering && row.safety == SafetyState::kFault;
    const bool is_new = row.fault != Fault::kNone && (row.fault != fault_ || is_back || is_pressed);
    safety_ = row.safety;
    fault_ = row.fault;
    return is_new;
  }

 private:
  HeldStops stops_;
  SafetyState safety_ = SafetyState::kIdle;
  Fault fault_ = Fault::kNone;
};

}  // namespace trocar
