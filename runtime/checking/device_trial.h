// SPDX-License-Identifier: Apache-2.0
// Tries a device without force: reads it at the rate of a session, commands zero torques, and measures times,
// losses, resolution, noise and the pose at the end. describe() says in words whether a session at this rate would hold.
// Tests: tests/runtime/checking/device_trial_test.cpp, tests/e2e/device_trial_test.py
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/fault_words.h"
#include "runtime/control/limits.h"
#include "runtime/device/hand_device.h"
#include "runtime/device/pose.h"
#include "runtime/realtime/histogram.h"
#include "runtime/realtime/late_ticks.h"
#include "runtime/realtime/realtime_thread.h"

namespace trocar::runtime {

struct DeviceTrialOptions {
  double rate_Hz = 1000, duration_s = 5;
  int cpu = -1;               ///< RealtimeOptions::cpu
  bool is_simulated = false;  ///< no motors, so that late ticks of this machine do no harm
  /// The limit of the time without data that a session with this device would have.
  double no_data_max_s = SafetyLimits{}.no_data_max_s;
  const std::atomic<bool>* stop = nullptr;  ///< ends the trial between two ticks
};

/// Noise of a value that moves slowly, from its second differences: a steady motion does not count.
class NoiseMeter {
 public:
  void add(double value) noexcept {
    if (count_ >= 2) {
      const double bend = value - 2 * last_ + before_;
      sum_ += bend * bend;
    }
    before_ = last_;
    last_ = value;
    ++count_;
  }
  /// Standard deviation of independent noise in each value. (That of a second difference is sqrt(6) times as large.)
  double deviation() const noexcept;

 private:
  double last_ = 0, before_ = 0, sum_ = 0;
  std::uint64_t count_ = 0;
};

/// The measurements of a trial.
struct DeviceTrial {
  std::uint64_t ticks = 0, readings = 0;  ///< readings: ticks that had a new state
  RealtimeReport realtime;
  LateTicks::Counts late_ticks{};
  Histogram state_interval;  ///< interval of two states, on the device's clock
  Histogram
      without_state;  ///< time of the loop from one new state to the next, if it woke up in time
  std::uint64_t lost_ticks = 0;  ///< ticks in which the link was lost
  FaultDetail fault;             ///< the first fault of the device's own checks
  double fault_t_s = 0;          ///< time of the trial at which it came
  double value_noise = 0;        ///< largest noise of a measured value, in its own unit
  double smallest_step = 0;      ///< smallest change of a measured value; 0: none changed
  double position_noise_m = 0;   ///< largest noise of the plate's position along an axis
  std::optional<Pose> last_T_device_plate;  ///< the last pose that the device's own checks accepted
  std::optional<LinkReport> link;           ///< counts of the link, with its round trips
};

/// Runs a trial. Blocks for the trial's duration. Errors: those of HandDevice::start().
Result<DeviceTrial> try_device(HandDevice& device, const DeviceTrialOptions& options);

/// The trial in words.
struct DeviceVerdict {
  std::string text;  ///< lines with what was measured, each with its line feed
  std::vector<std::string>
      troubles;  ///< reasons why a session would end or be disturbed, with advice; empty: none
};
DeviceVerdict describe(const DeviceTrial& trial, const DeviceTrialOptions& options,
                       const DeviceSpecification& specification);

}  // namespace trocar::runtime
