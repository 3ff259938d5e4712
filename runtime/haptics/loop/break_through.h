// SPDX-License-Identifier: Apache-2.0
// Break-throughs, and the damping of the plunge after one.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>

#include "runtime/device/device.h"
#include "runtime/haptics/puncture.h"
#include "runtime/haptics/tool.h"

namespace trocar::runtime {

// A break-through: the resistance in front of the tip falls, and the tip runs on. This file is the
// only definition. Sound, rumble, charts, recordings, reports and history use its events.
//
// Inputs of a tick in `running`: the force F of the tissue on the tip, and the ways s and h that the
// tip, and a tip that is rigidly fixed to the plate, have gone along the shaft, inwards. Laws:
//  1. The depth d is the largest s so far; if the tip comes back by more than kBreakBack_m, d follows
//     at this distance. The advance of a tick is the change of d, if positive. So neither unloading,
//     nor pressing again, nor the way back into a hole is an advance. F' and s' are F and s after
//     equal low-passes of first order with the time constant kBreakFilter_s; d' is the depth of s'.
//  2. The loss is u(F, P) = 1 / (1 + (2 (F + f) / (P + f))^6) with f = kBreakNoise_N: 0.5 if F + f
//     is half of P + f, 0.985 at a quarter, 0.015 without a fall. A relative change of F or of P
//     changes u by at most 6 times as much, so nothing that is made from u has a step.
//  3. State `loaded`: the reference P is the largest F'; it is multiplied by
//     exp(-change of d' / kBreakReach_m) while d' grows, and P is 0 when d' falls. So P is the
//     resistance of the last millimetres, not of a time. A tip that jumps does so because the
//     resistance fell: here and in law 4 a change of d' counts as at most kBreakFeed_m_per_s. The
//     mean loss is that of u(F', P) over d', a low-pass with the length kBreakRun_m.
//  4. A fall begins when the mean loss reaches kFallBegins; P then stays as it is. It is a
//     break-through in the tick in which the mean loss reaches one half: its only event. The fall is
//     over, and the state is `loaded` again, after an advance of kBreakReach_m, or when F' + f
//     exceeds kBreakRise times its smallest value since the begin, if there was no break-through
//     yet: 0.97 (P + f). So a fall in several steps is one break-through.
//  5. Laws `hooke` and `network`: each puncture of a sheet (ContactOutput::is_released) is a fall and
//     a break-through at once. P is at least the force before it, or the trial force if the sheet
//     was reached and punctured in one tick.
//  6. The plunge of a fall is the sum of u(F, P) times the advance, until kPlunge_s after its begin
//     or, if it is one, after the break-through, until d falls, or until a tick is not in
//     `running`: the way that the tip runs on, for as long as nothing bears it again. Advances
//     before the begin count with the factor exp(-t / kBreakMemory_s), where t is the time to the
//     begin.
//  7. Neither the boundaries of slices nor punctures enter laws 1 to 4 and 6: bone of equal strength
//     gives no break-through, however it is sliced.
// Realtime-safe.

inline constexpr double kBreakFilter_s = 0.003, kBreakMemory_s = 0.1, kPlunge_s = 0.5;
inline constexpr double kBreakNoise_N = 1.5, kBreakRise = 1.5, kFallBegins = 0.03;
inline constexpr double kBreakFeed_m_per_s = 0.04;
inline constexpr double kBreakReach_m = 2e-3, kBreakRun_m = 2e-5, kBreakBack_m = 1e-3;

/// The loss u of law 2.
double loss_of_resistance(double force_N, double reference_N) noexcept;

/// What is known in the tick in which a fall begins, or is found to be a break-through.
struct ResistanceFall {
  double reference_N = 0;  ///< P
  // The part of the plunge before this tick, and the part of it by which the hand moved.
  double run_m = 0, run_hand_m = 0;
  // What was punctured last: index of a sheet or of a soft layer; both -1: nothing yet. If nothing
  // was punctured yet, `sheet` is the active one.
  std::int32_t sheet = -1, layer = -1;
};

/// Result of a tick.
struct BreakThroughTick {
  bool is_running = false;
  double force_N = 0;       ///< F
  double advance_m = 0;     ///< law 1
  bool comes_back = false;  ///< the depth falls
  double hand_m = 0;        ///< change of h since the last advance; 0 without an advance
  std::optional<ResistanceFall> begun;
  std::optional<ResistanceFall> found;  ///< a break-through
};

/// A way along the shaft, and its depth (law 1).
struct BreakDepth {
  double at_m = 0, depth_m = 0;
  /// Returns the change of the depth.
  double move_to(double at_m) noexcept;
};

/// Kept between ticks, by the loop.
struct BreakThroughState {
  enum class Phase : std::uint8_t { kLoaded, kFalling, kFallen };
  Phase phase = Phase::kLoaded;
  bool has_last = false;
  Eigen::Vector3d tip_m = Eigen::Vector3d::Zero(), plate_tip_m = tip_m;  ///< of the last tick
  BreakDepth tip, filtered;                                              ///< of s and s'
  double h_m = 0, filtered_N = 0;       ///< h since the last advance; F'
  double reference_N = 0, least_N = 0;  ///< P; smallest F' since the fall began
  double mean_loss = 0, run_m = 0, run_hand_m = 0, fallen_for_m = 0;
  std::int32_t sheet = -1, layer = -1;  ///< punctured last
};

struct BreakThroughInput {
  double interval_s = 1e-3;
  Eigen::Vector3d tip_m = Eigen::Vector3d::Zero();        ///< RecordingRow::tool_m
  Eigen::Vector3d plate_tip_m = Eigen::Vector3d::Zero();  ///< of a tool fixed to the plate
  Eigen::Vector3d inward = -Eigen::Vector3d::UnitZ();     ///< unit vector along the shaft
  const ContactOutput& contact;
};

/// Takes a tick in `running`. Call `state = {}` in other ticks.
BreakThroughTick find_break_through(const BreakThroughInput& input,
                                    BreakThroughState& state) noexcept;

// Damps the plunge of the tool after a break. When the tip breaks through bone, nothing supports
// the tip any more, and the hand that pressed accelerates the plate inwards. If the hand lets go at
// that moment, only the friction of the shaft stops the plate. With the damper the plate stops
// after a few millimetres.
//
// A break is a tick in which the force law reports a lost force (ContactOutput::lost_force_N).
// Contract:
//  1. The force acts on the tip along the shaft, outwards. It is a coefficient times the inward
//     speed of the tip by the estimated twist (estimator.h), and zero if the tip moves outwards.
//  2. Right after a break the coefficient is the lost force divided by kBreakSpeed_m_per_s; then it
//     is multiplied by the course 1 - (t / kBreakDamping_s)^2. A later break starts the course anew
//     if that raises the coefficient. It is never above damping_max().
//  3. Whatever the speeds are: the force is at most the lost force times the course, and it changes
//     by at most the lost force in kBreakSlew_s.
//  4. Without a break the damper has no force.

/// Speed of the tip at which the damper's force right after a break equals the lost force.
inline constexpr double kBreakSpeed_m_per_s = 1.5;
inline constexpr double kBreakDamping_s = 0.1;
inline constexpr double kBreakSlew_s = 5e-3;

/// Largest coefficient: damping * interval / plate mass is below 2 with a large reserve, so that
/// the sampled damper is stable.
double damping_max(double plate_mass_kg, double interval_s) noexcept;

/// Inputs of a tick.
struct BreakInput {
  Pose T_device_plate = {};
  Twist twist_device = Twist::Zero();  ///< estimated
  double interval_s = 1e-3;            ///< duration of a tick
  double lost_force_N = 0;             ///< ContactOutput::lost_force_N
};

/// State kept between ticks.
struct BreakDamperState {
  double lost_N = 0;   ///< of the break that began the course
  double left_s = 0;   ///< time until the course ends
  double force_N = 0;  ///< force of this tick, along the shaft outwards
};

/// Returns the damper's wrench on the plate, in {B}.
Wrench damp_break(double plate_mass_kg, const Tool& tool, const BreakInput& input,
                  BreakDamperState& state) noexcept;

}  // namespace trocar::runtime
