// SPDX-License-Identifier: Apache-2.0
// Chooses the interval over which velocities are computed, and corrects the velocity if a device
// state came late.
//
// If encoders have a coarse resolution and are read at a high rate, an angle changes by only a few
// counts per sample, so the velocity is noisy. (A count is one step of the resolution.) If the
// velocity is computed over a longer interval, the noise is smaller, but the velocity lags behind
// that of an accelerating tool. The interval, called the window, is therefore extended only while
// the motion is steady: the window is the longest interval in which all readings of each encoder
// are within one count of the straight line from the first to the last reading. Each reading is
// within half a count of the true angle, so a motion of constant velocity never ends a window.
//
// Source: F. Janabi-Sharifi, V. Hayward, C. Chen, Discrete-time adaptive windowing for velocity
// estimation, IEEE TCST 8(6), 2000.
//
// Contract (tests/runtime/control/velocity_window_test.cpp):
//  1. With exact encoders and device states on time, velocities are computed from the
//     last two states.
//  2. In a steady motion the window grows to kVelocitySamples intervals. The error of an encoder's
//     velocity is then at most one count divided by the duration of the window.
//  3. The window goes back only as far as the readings of every encoder stay within a count of
//     the straight line.
//  4. A device state is late if it came more than a period after the previous state. If the newest
//     state is late and the motion is not steady, the velocity is extrapolated to the time half a
//     period before the newest state. For this, the mean velocity of each of the last two intervals
//     is taken to hold in the middle of the interval, and the velocity is assumed to change
//     linearly. (If states are on time, the mean velocity of the last interval is the velocity half
//     a period before the newest state.) Exceptions: if the interval before the last one is shorter
//     than half a period, item 4 does not apply, because an error of the time stamps would be amplified.
//     Unless the encoders are exact, item 4 does not apply either if the last interval is more than
//     twice as long as the one before, because the noise of the encoders would be amplified.
#pragma once

#include <array>

#include "runtime/device/hand_device.h"
#include "runtime/device/pose.h"

namespace trocar::runtime {

inline constexpr int kVelocitySamples = 32;

/// The latest device states that passed the checks, with ascending times, in a ring of fixed size.
/// Nothing is allocated.
class VelocityWindow {
 public:
  /// Adds the newest device state and its pose. Precondition: times ascend.
  void add(const Measurement& measured, const Pose& T_device_plate) noexcept;
  void clear() noexcept { count_ = 0; }
  /// Returns the pose and age of the first state of the window that ends at the newest state. In
  /// the case of item 4, no stored pose gives the right velocity. The function then returns a
  /// computed earlier pose, chosen so that the displacement from it to the newest pose, divided by
  /// the age, is the velocity of item 4. An age of 0 means that no pose was chosen; the caller then
  /// uses the pose of the previous state. `resolution`:
  /// DeviceSpecification::resolution(), the resolution of the measured values. `period_s`:
  /// period of the loop.
  PreviousPose begin(double resolution, double period_s) const noexcept;

 private:
  PreviousPose late_begin(double period_s, double min_before) const noexcept;
  PreviousPose steady_begin(double resolution) const noexcept;
  struct Sample {
    Measurement state;
    Pose T_device_plate;
  };
  const Sample& ago(int samples) const noexcept {
    return ring_[static_cast<std::size_t>((next_ + kVelocitySamples - samples) %
                                          (kVelocitySamples + 1))];
  }
  std::array<Sample, kVelocitySamples + 1> ring_;
  int next_ = 0, count_ = 0;
};

}  // namespace trocar::runtime
