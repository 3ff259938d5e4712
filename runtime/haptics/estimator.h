// SPDX-License-Identifier: Apache-2.0
// The estimate of the plate's motion at which every force law is evaluated, and how stiff a contact
// may be.
//
// Readings are noisy, rounded and late, and a force is held for a tick. A critically damped g-h
// filter (the steady Kalman filter of a motion at constant velocity) estimates pose and twist from
// the readings. The law is evaluated at the estimated pose plus `lead` times the estimated twist.
// On a spring K the lead is a damper K * lead: linear, without switching. Filter and lead are
// designed once, before the session.
//
// With the period T of the loop and the delay of the device, tau = T / 2 + delay is the mean age
// of the force that the hand feels. At the angular frequency w the loop renders the damping
//   Re{ K (H_x + lead H_v) hold exp(-j w delay) / (j w) }, where H_x and H_v are the filter's
// transfer functions to position and velocity, and hold is that of the zero-order hold. Together
// with the damping b of the device it must be at least a tenth of the smaller of b and K tau, at
// all w up to 60 Hz (motions of a hand) and up to 1.5 sqrt(K / M). Where a lead can do it, the
// plate on the spring also has a damping ratio of 0.025, so that its oscillation dies out in a
// second or so; not so with exact readings, which only tests have, for the least lead.
//
// Sources: J. Colgate, J. Brown, Factors affecting the Z-width of a haptic display, ICRA 1994;
// N. Diolaiti, G. Niemeyer, F. Barbagli, K. Salisbury, Stability of haptic rendering:
// discretization, quantization, time delay, and Coulomb effects, IEEE T-RO 22(2), 2006;
// J. Abbott, A. Okamura, Effects of position quantization and sampling rate on virtual-wall
// passivity, IEEE T-RO 21(5), 2005.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "runtime/device/device.h"

namespace trocar::runtime {

/// Highest frequency of a hand's motions (tremor, taps and shaking).
inline constexpr double kHandMotion_Hz = 60;
/// A contact at rest may alternate by kQuiet_N, or by kQuietShare of its force if that is more.
inline constexpr double kQuiet_N = 0.1, kQuietShare = 0.01;
inline double quiet_N(double force_N) noexcept {
  return std::max(kQuiet_N, kQuietShare * force_N);
}

struct LoopTiming {
  double period_s = 1e-3;
  double delay_s = 0;  ///< from a motion to the force that answers it, without the hold
  double lag_s() const noexcept { return period_s / 2 + delay_s; }  ///< tau
};

/// One direction of motion of the plate; all values at the plate's origin. In rotation: kg m^2,
/// N m s, rad.
struct PlateAxis {
  double mass_kg = 1;
  double damping_N_s_per_m = 0;  ///< b, of the device's own friction
  double noise_m = 0;            ///< standard deviation of a reading, sigma
  double resolution_m = 0;       ///< smallest step of a reading, delta
};

/// Filter and lead of one direction. Exact readings need no filter: infinite bandwidth.
struct AxisEstimator {
  double bandwidth_per_s = std::numeric_limits<double>::infinity();
  double lead_s = 0;
  friend bool operator==(const AxisEstimator&, const AxisEstimator&) = default;
};
struct PoseEstimator {
  AxisEstimator translation, rotation;
  friend bool operator==(const PoseEstimator&, const PoseEstimator&) = default;
};

/// alpha and beta of the filter for readings `interval_s` apart.
struct FilterGains {
  double alpha = 1, beta = 1;
};
inline FilterGains filter_gains(double bandwidth_per_s, double interval_s) noexcept {
  const double q = std::exp(-bandwidth_per_s * interval_s);
  return {1 - q * q, (1 - q) * (1 - q)};
}

/// Steps of the led position from tick to tick: `rms` per noise of a reading, and `first` in answer
/// to a reading that steps by 1.
struct StepGain {
  double rms = 0, first = 0;
  /// Largest alternation of the led position at rest: 3.3 rms sigma + first delta.
  double alternation_m(const PlateAxis& axis) const noexcept {
    return 3.3 * rms * axis.noise_m + first * axis.resolution_m;
  }
};
StepGain step_gain(const AxisEstimator& estimator, double period_s);

/// Standard deviation of the estimated speed at rest.
double speed_noise(const AxisEstimator& estimator, double period_s, const PlateAxis& axis);

/// Damping of loop and device at the angular frequency `w`, N s/m, for a spring K and a damper of
/// the tissue.
double rendered_damping(const AxisEstimator& estimator, const LoopTiming& timing,
                        const PlateAxis& axis, double K_N_per_m, double tissue_N_s_per_m, double w);

/// The fastest estimator for which loop and device damp as above and a contact at rest alternates
/// by at most `quiet_N`; if there is none, the one with the least alternation. Exact readings: no
/// filter, and the least lead. `tissue_N_s_per_m`: a damper of the tissue, which acts like a lead.
/// Nullopt: none damps.
std::optional<AxisEstimator> design_estimator(const LoopTiming& timing, const PlateAxis& axis,
                                              double K_N_per_m, double tissue_N_s_per_m = 0,
                                              double quiet_N = 0);

/// Largest stiffness that loop and device hold: max(b / tau, 0.1 M / tau^2 where tau <= 2.6 ms), or
/// less if no estimator exists for it. (A lead damps only motions slower than about 0.16 / tau,
/// and a tau above 2.6 ms puts 60 Hz beyond.)
/// `margin` divides the mass.
double stable_stiffness(const LoopTiming& timing, const PlateAxis& axis, double margin = 1);

/// Largest stiffness up to `most_N_per_m` with which a contact at rest alternates by at most
/// kQuiet_N; 0: none.
double quiet_stiffness(const LoopTiming& timing, const PlateAxis& axis, double most_N_per_m);

/// The estimate, kept between ticks. Realtime-safe.
class EstimatedPose {
 public:
  void reset() noexcept { has_begun_ = false; }
  /// Takes a reading, `interval_s` after the last one, of a loop with this period. The first one
  /// begins at rest. The twist is that of half a period before the reading, also after an interval
  /// of several periods, under the assumption that it changes linearly. The gains are those of the
  /// interval, so that a reading soon after another changes the twist little, whatever its stamp.
  void follow(const PoseEstimator& estimator, const Pose& T_device_plate, double interval_s,
              double period_s) noexcept;

  const Pose& pose() const noexcept { return pose_; }
  const Twist& twist_device() const noexcept { return twist_; }
  /// The pose `lead` ahead.
  Pose ahead(const PoseEstimator& estimator) const noexcept;

 private:
  bool has_begun_ = false;
  Pose pose_;
  Twist twist_ = Twist::Zero();
};

}  // namespace trocar::runtime
