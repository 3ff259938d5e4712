// SPDX-License-Identifier: Apache-2.0
// Tries a device without force: reads the device at the rate of a session and commands zero
// torques. The trial measures the times from each new device state to the next, lost data, and the
// resolution and noise of the measured values. It also keeps the last pose. On request it then
// pushes the free device with a small force, and measures delay, mass and friction by its answer.
// describe() says in words whether a session at this rate would run undisturbed.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/faults.h"
#include "runtime/check/device_response.h"
#include "runtime/device/device.h"
#include "runtime/device/hand_device.h"
#include "runtime/realtime/histogram.h"
#include "runtime/realtime/realtime_thread.h"
#include "runtime/session/session_options.h"

namespace trocar::runtime {

/// Measures the noise of a slowly changing value. The noise is computed from the second differences
/// of the value, to which a steady motion does not contribute.
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
  /// Standard deviation of the noise of one value, if the noise of successive values is
  /// independent. (The standard deviation of the second differences is sqrt(6) times as large.)
  double deviation() const noexcept;

 private:
  double last_ = 0, before_ = 0, sum_ = 0;
  std::uint64_t count_ = 0;
};

/// The measurements of a trial. A measured value is one that the device itself measures, such as an
/// encoder angle.
struct DeviceTrial {
  std::uint64_t ticks = 0, readings = 0;  ///< readings: ticks with a new state of the device
  RealtimeReport realtime;
  LateTicks::Counts late_ticks{};
  Histogram state_interval;  ///< time from one new state to the next, on the device's clock
  /// Time from one new state to the next on the loop's clock, without intervals in which the loop
  /// missed a deadline.
  Histogram without_state;
  std::uint64_t lost_ticks = 0;  ///< ticks in which the link was lost or the device had a fault
  FaultDetail fault;             ///< the first fault that the device's own checks found
  double fault_t_s = 0;          ///< time of this fault, from the start of the trial
  double value_noise = 0;        ///< largest noise of a measured value, in the value's unit
  double smallest_step = 0;      ///< smallest change of an angle or a position; 0: none changed
  double position_noise_m = 0;   ///< largest noise of the plate's position along an axis
  bool was_pushed = false;
  std::optional<DeviceResponse> response;   ///< nullopt: not pushed, or no answer could be fitted
  std::optional<Pose> last_T_device_plate;  ///< the last pose that the device's own checks accepted
  std::optional<LinkReport> link;           ///< packets and round trips of the link; none: no link
};

/// Runs a trial: starts the device, reads it for the trial's duration, and closes it. Blocks until
/// the end. `options`: those of the session with this device; its rate, duration, processor and
/// stop are the trial's. Errors: those of HandDevice::start(); kRefused if `options.stop` has ended
/// the trial, because too short a trial does not show whether a session would run. `push_N`: force
/// along x of {B} with which the device is pushed to and fro by some millimetres, after the time
/// without force; 0: not pushed.
Result<DeviceTrial> try_device(HandDevice& device, const SessionOptions& options,
                               double push_N = 0);

/// A description of a trial in words.
struct DeviceVerdict {
  std::string text;  ///< lines about the measurements; each line ends with a line feed
  /// Reasons why a session would end or be disturbed, with advice; empty: it would run undisturbed.
  std::vector<std::string> troubles;
};
DeviceVerdict describe(const DeviceTrial& trial, const SessionOptions& options,
                       const DeviceSpecification& specification);

}  // namespace trocar::runtime
