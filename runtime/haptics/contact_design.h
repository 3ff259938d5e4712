// SPDX-License-Identifier: Apache-2.0
// The rule for stiffness: how stiff a contact may be on a device, and the estimator that goes with
// it. docs/device-stiffness.md says it for device owners.
//
// A rendered stiffness K is at most the least of three bounds:
//  - device: what its maker or the operator states
//  - stable: stable_stiffness() (estimator.h)
//  - quiet: a / (3.3 c sigma + p delta), with the noise sigma and the resolution delta of the
//    readings, the estimator's gains c and p (StepGain), and the alternation a = quiet_N() of a
//    contact at rest that a hand does not feel.
#pragma once

#include <limits>
#include <string>

#include "formats/base/result.h"
#include "runtime/device/hand_device.h"
#include "runtime/haptics/estimator.h"

namespace trocar::runtime {

struct PlateAxes {
  PlateAxis translation, rotation;
};

/// The plate at a pose: the smallest damping and moment of inertia of all directions. A device that
/// renders no moment cannot be unstable in rotation.
PlateAxes plate_axes(const DeviceSpecification& device, const Pose& T_device_plate);

/// Limits of the stiffness that a law renders, in addition to the limits that follow from the
/// scene, the device and the rate.
struct StiffnessLimits {
  /// Divides two values of the description: the plate's mass and inertia in the stable stiffness,
  /// and the largest stiffness in the description of a device that measures its own pose
  /// (set_pose_device_options()). The margin is 1 for a simulated device, whose description is
  /// exact, and kHardwareMargin for a device that is assumed to have motors.
  double margin = 1;
  /// Largest stiffness at the tip that the operator or the device's description allows.
  double max_N_per_m = std::numeric_limits<double>::infinity();
  /// The smaller of that and what the device states.
  double most_N_per_m(const DeviceSpecification& device) const noexcept {
    const double stated = device.stiffness_max_N_per_m();
    return stated > 0 ? std::min(stated, max_N_per_m) : max_N_per_m;
  }
};
inline constexpr double kHardwareMargin = 2;

/// Largest stiffness and damping that a law renders at the plate's origin, with the force scale.
struct RenderedStiffness {
  double translation_N_per_m = 0, rotation_Nm_per_rad = 0;
  double damping_N_s_per_m = 0;
  double lever_m = 0;  ///< distance of the force's line from the origin: turning moves the contact
};

struct ContactDesign {
  LoopTiming timing;
  PlateAxes axes;
  bool resolution_is_assumed = false;  ///< DeviceReadings::is_assumed
  RenderedStiffness rendered;
  PoseEstimator estimator;
  /// The bounds of device and operator (infinite: not stated), and of stability.
  double device_N_per_m = std::numeric_limits<double>::infinity(), stable_N_per_m = 0;
  /// Stiffness in a contact at rest: `rendered`, or less if that stiffens with the force.
  double rest_N_per_m = 0;
  /// Largest alternation of the led pose at rest: 3.3 c sigma + p delta.
  double alternation_m = 0, alternation_rad = 0;
  /// Of the force on the plate.
  double alternation_N() const noexcept {
    return rest_N_per_m * (alternation_m + rendered.lever_m * alternation_rad);
  }
};

/// Alternation of the estimator that is aimed at.
inline constexpr double kQuietTarget_N = 0.7 * kQuiet_N;

/// Designs the estimator: the fastest that alternates by at most `quiet_N` (design_estimator()).
/// Error kRefused if a rendered stiffness is above the stable one, or if none is stable.
Result<ContactDesign> design_contact(const DeviceSpecification& device, const PlateAxes& axes,
                                     const LoopTiming& timing, const RenderedStiffness& rendered,
                                     const StiffnessLimits& limits = {},
                                     double quiet_N = kQuietTarget_N);

/// Lines for `check`: readings, the bounds with the one that binds, the estimator.
std::string describe(const ContactDesign& design);

/// A warning if a contact at rest alternates by more than quiet_N(0); else empty.
std::string contact_warning(const ContactDesign& design);

}  // namespace trocar::runtime
