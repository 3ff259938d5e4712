// SPDX-License-Identifier: Apache-2.0
// Chooses the interval over which velocities are computed, and
// corrects the velocity if a device state came late.
//
// If encoders have a coarse resolution and are read at a high rate, the angle changes by only a few
// counts per sample, so the velocity is noisy. A longer interval reduces the noise, but lags behind
// an accelerating tool. The interval, called the window, is therefore extended only while the
// motion is steady (F. Janabi-Sharifi, V. Hayward, C. Chen, Discrete-time adaptive windowing for
// velocity estimation, IEEE TCST 8(6), 2000). The window is the longest interval in which all
// readings of each encoder are within one count of the straight line from the first to the last
// reading. Each reading is within half a count of the true angle, so a motion of constant velocity
// never ends a window.
//
// Contract (tests/runtime/control/velocity_window_test.cpp):
//  1. With exact encoders and device states on time, velocities are computed from the
//     last two states.
//  2. In a steady motion the window grows to kVelocitySamples states. The error of a velocity is
//     then at most one count of each encoder over the whole window.
//  3. The window ends where the readings of an encoder deviate from the straight line by more
//     than a count.
//  4. A device state is late if it came more than a period after the state before. If the newest
//     state is late and the motion is not steady, the velocity is that at half a period before the
//     newest state, as if it had been on time. This velocity is extrapolated from the mean
//     velocities of the last two intervals, each of which is taken as the velocity in the middle
//     of its interval.
#pragma once

#include <array>

#include "runtime/device/hand_device.h"
#include "runtime/device/pose.h"

namespace trocar::runtime {

inline constexpr int kVelocitySamples = 32;

/// The latest device states that passed the checks, with ascending times, in a ring of fixed
/// size. No allocation.
class VelocityWindow {
 public:
  void add(const Measurement& measured, const Pose& T_device_plate) noexcept;
  void clear() noexcept { count_ = 0; }
  /// Returns the pose and age of the first state of the window that ends at the newest state. In
  /// the case of item 4, returns instead a pose from which a steady motion to the newest pose has
  /// the velocity of item 4. If the result has the age 0, the caller must use the pose of the
  /// previous state. `resolution`: that of the measured values (DeviceSpecification::resolution()).
  /// `period_s`: period of the loop.
  PreviousPose begin(double resolution, double period_s) const noexcept;

 private:
  PreviousPose late_begin(double period_s, double least_before) const noexcept;
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
