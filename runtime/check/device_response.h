// SPDX-License-Identifier: Apache-2.0
// How a free device answers a small force: its delay, mass and friction.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace trocar::runtime {

/// A tick of a trial: position, and the force commanded in it, along one direction.
struct ResponseSample {
  double t_s = 0, position_m = 0, force_N = 0;
};

struct DeviceResponse {
  double mass_kg = 0, damping_N_s_per_m = 0, coulomb_N = 0;
  double delay_s = 0;   ///< as DeviceDescription::delay_s
  double misfit_m = 0;  ///< root mean square
};

/// Fits M x'' = F(t - delay) - b x' - c sign(x') from rest, by the method of Levenberg and
/// Marquardt. Nullopt if the motion is too small, or if no such device moves so.
std::optional<DeviceResponse> fit_response(std::span<const ResponseSample> samples);

/// Decides the force of each tick: a push until the device has moved a little, a pause, a push
/// back, a pause, and a push that brakes a device which still moves.
class ResponsePush {
 public:
  ResponsePush(double force_N, double period_s) : force_N_(force_N), period_s_(period_s) {
    samples_.reserve(static_cast<std::size_t>(kLongest_s / period_s) + 2);
  }
  static constexpr double kFar_m = 4e-3, kFarthest_m = 2e-2, kLongest_s = 1.2;

  /// Takes the position of a tick, and returns the force. Realtime-safe.
  double take(double position_m) noexcept;
  bool is_done() const noexcept { return phase_ == kDone; }
  const std::vector<ResponseSample>& samples() const noexcept { return samples_; }

 private:
  enum Phase : std::uint8_t { kPush, kPause, kPushBack, kCoast, kBrake, kDone };
  double force_N_, period_s_;
  Phase phase_ = kPush;
  double t_s_ = 0, since_s_ = 0, from_m_ = 0, low_m_ = 0;
  std::vector<ResponseSample> samples_;
};

}  // namespace trocar::runtime
