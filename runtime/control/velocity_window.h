// SPDX-License-Identifier: Apache-2.0
// The time over which velocities are taken, and the velocity of a state that came late.
//
// Encoders of a coarse resolution, read at a high rate, give a velocity of a few counts per sample:
// noise. A longer time gives less of it, and lags behind an accelerating tool. The window is
// therefore as long as the motion is steady (F. Janabi-Sharifi, V. Hayward, C. Chen, Discrete-time
// adaptive windowing for velocity estimation, IEEE TCST 8(6), 2000): the longest one over which a
// straight line from the first to the last reading of each encoder is within one count of all
// readings between. Each of the three readings is within half a count of the true angle, so a
// steady motion never ends a window.
//
// Contract (tests/runtime/control/velocity_window_test.cpp):
//  1. With exact encoders and states on time, velocities are taken since the last state.
//  2. In a steady motion the window grows to kVelocitySamples states; a velocity's error is then at
//     most one count of each encoder over the whole window.
//  3. It ends where an encoder's readings leave the straight line by more than a count.
//  4. Where the motion is not steady and the last state is more than a period ago, the velocity is
//     that of half a period before the newest state, as if states had come in time: the mean over
//     the last interval is that of its middle, and is carried on by its change since the interval
//     before.
#pragma once

#include <array>

#include "runtime/device/device.h"
#include "runtime/mechanism/pose.h"

namespace trocar::runtime {

inline constexpr int kVelocitySamples = 32;

/// The latest good states, with ascending times. A ring of fixed size: no allocation.
class VelocityWindow {
 public:
  void add(const DeviceState& state, const Pose& T_device_plate) noexcept;
  void clear() noexcept { count_ = 0; }
  /// The pose at which a window begins that ends at the newest one, or from where a steady motion
  /// would have item 4's velocity; none: the last state's. `count_rad`: the encoders' resolution,
  /// 0: exact. `period_s`: of the loop.
  PreviousPose begin(double count_rad, double period_s) const noexcept;

 private:
  PreviousPose late_begin(double period_s, double least_before) const noexcept;
  PreviousPose steady_begin(double count_rad) const noexcept;
  struct Sample {
    DeviceState state;
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
