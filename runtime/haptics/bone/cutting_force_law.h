// SPDX-License-Identifier: Apache-2.0
// The force law `cutting`, and the coupling of its tool to the device.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "formats/base/result.h"
#include "runtime/device/hand_device.h"
#include "runtime/haptics/bone/bone_contact.h"
#include "runtime/haptics/bone/bone_volume.h"
#include "runtime/haptics/force_law.h"

namespace trocar::runtime {

// Chooses the coupling between the device's plate and the tool in the bone. The coupling has the
// stiffness that the scene states, within the limits of contract 3. If the scene states no
// stiffness, the coupling is as stiff as these limits allow.
//
// Let T be the duration of a tick, K the stiffness matrix that the device renders at the plate, dx
// the displacement of the plate in a tick and dx^T its transpose. A wrench that is held for a tick
// releases at most dx^T K dx / 2 (cutting_law.h, contract 1). Let B be the damping matrix that the
// device's own friction gives the plate (DeviceSpecification::damping()). The damping absorbs the
// released energy if B - K T / 2 has no negative eigenvalue (J. Colgate, G. Schenkel, Passivity of
// a class of sampled-data systems, J. Robotic Systems 14(1), 1997). If B is too small, the law is
// evaluated at a pose that is predicted one tick ahead. Let M be the mass of the plate. With
// prediction, the loop released no energy in simulations in which K T^2 / M was at most 0.5
// (tests/runtime/haptics/bone/cutting_feel_test.cpp).
//
// Contract:
//  1. SceneForceLaw::axis says whether the tool is rigidly fixed to the plate or connected by a
//     coupling spring. If the scene leaves the choice open (kAuto), the tool is rigid if the tissue
//     can never be stiffer than the coupling spring would be, in translation and in rotation.
//  2. `damping_share` is the largest factor f for which B - f K T / 2 has no negative eigenvalue.
//     If the tool is rigid, K is an upper bound. In translation it is the stiffness that the tissue
//     has in its stiffest direction, times SceneForceLaw::force_scale. In rotation it is this value
//     times the square of the lever, which is the distance from the plate's origin to the tip plus
//     5 cm. The bound on rotation is too high if the tissue is stiffer along the tool's axis than
//     across it. At worst, this causes a prediction that is not needed. In return, K is positive
//     definite even without walls.
//  3. With prediction, the stiffness of the coupling spring is at most 0.5 M / T^2, divided by the
//     force scale (SceneForceLaw::force_scale) and by StiffnessLimits::margin. The limit in
//     rotation is the same with the plate's smallest moment of inertia instead of M. If the scene
//     states no stiffness (the value 0), the coupling gets this limit, whether the pose is
//     predicted or not. Whatever the scene says, the rendered stiffness at the tip never exceeds
//     the largest stiffness that the device states (stiffness_max_N_per_m()), nor the operator's
//     limit (StiffnessLimits). If a rigid tool would exceed one of these two limits, the tool gets
//     a coupling even if the scene declares it rigid.
//  4. A rigid tool, and a coupling spring without prediction, can render a stiffness above 0.5 M /
//     T^2, divided by StiffnessLimits::margin. Then `inertia_share` exceeds `inertia_limit`. Unless
//     the device's damping suffices without prediction (contract 2), may_start() is then false, and
//     a session refuses to start. In rotation, `inertia_share` and contract 1 use two levers: the
//     lever of contract 2 for the stiffness of the walls, and the distance of the tool's axis from
//     the plate's origin for the stiffness along this axis. (A force along an axis through the
//     origin does not turn the plate.)
//  5. With prediction, a motion of the plate whose frequency f is above a sixth of the loop's rate
//     receives energy from the loop, because the rendered force lags behind the motion. A pose that
//     is predicted from the last two poses leads a sinusoidal motion by the angle atan(sin a / (2 -
//     cos a)), where a = 2 pi f T. The force is held for a tick and therefore lags by a / 2. Both
//     angles are equal at a = pi / 3, where f is a sixth of the rate. At higher f the lag is larger
//     than the lead. For this reason stability_warning() warns if the pose is predicted and the
//     rate of the loop is below kMinPredictedRate_Hz.
//  6. The coupling's largest force is the one that the device can render along the tool at its peak
//     torques, divided by the force scale.

/// The largest K T^2 / M for which the law was tested at a predicted pose.
inline constexpr double kMaxInertiaShare = 0.5;
/// Highest frequency of a hand's motions (tremor, taps and shaking). For motions up to this
/// frequency a session must be passive.
inline constexpr double kHandMotion_Hz = 60;
/// Lowest rate of the loop at which a law that predicts the pose counts as passive for motions of a
/// hand. It is six times kHandMotion_Hz (contract 5), plus a ninth of this product as a margin for
/// the harmonics of such motions.
inline constexpr double kMinPredictedRate_Hz = 400;

struct DeviceCoupling {
  CuttingCoupling coupling;
  bool predicts_pose = false;  ///< the law is evaluated at the pose predicted one tick ahead
  double rate_Hz = 0;          ///< rate of the loop
  double damping_share = 0;    ///< contract 2; at least 1: the device's own damping suffices
  /// The rendered stiffness in translation divided by M / T^2, or in rotation divided by I / T^2,
  /// whichever is larger. I is the plate's smallest moment of inertia. With prediction, tests show
  /// passivity only up to inertia_limit.
  double inertia_share = 0;
  double inertia_limit = kMaxInertiaShare;  ///< kMaxInertiaShare divided by StiffnessLimits::margin
  /// The rendered stiffness in translation, before it is multiplied by the force scale.
  double rendered_N_per_m = 0;
  /// Largest tissue force along the tool that the device can render; 0: the device cannot be at the
  /// given pose.
  double max_N = 0;
  /// The stiffness that the device states or the operator's limit, whichever is smaller, divided by
  /// the force scale. It is infinite if neither is stated.
  double ceiling_N_per_m = 0;
  bool is_at_ceiling = false;  ///< the coupling's stiffness was reduced to ceiling_N_per_m
};

/// Chooses the coupling for one pose of the plate, for example with the tip on top of the bone.
DeviceCoupling choose_coupling(const BoneVolume& bone, const SceneForceLaw& law,
                               const DeviceSpecification& device, const Pose& T_device_plate,
                               double rate_Hz, const StiffnessLimits& limits = {});

/// Returns the choice as one line of text, for `check`.
std::string describe(const DeviceCoupling& chosen, const SceneForceLaw& law);

/// False if the rendered stiffness is too large for the plate's inertia and the rate (contract 4).
bool may_start(const DeviceCoupling& chosen);

/// Returns one line that says why may_start() is false, and which stiffness or rate would do.
/// `enough_Hz`: lowest rate of the loop at which it would be true; 0: no rate would do.
std::string why_not_passive(const DeviceCoupling& chosen, double enough_Hz);

/// Returns a text that says why, with this choice, the loop may oscillate or release energy to the
/// hand, and what helps. The text is empty if there is no such reason. Precondition: may_start().
std::string stability_warning(const DeviceCoupling& chosen);

// The force law `cutting`. The tool cuts through one bone volume (bone_volume.h). The tool
// in the bone is connected to the plate by a spring, or is rigidly fixed to the plate
// (below). The law itself is passive (cutting_law.h, contract 1).

/// Figures of a session, for its summary. Forces and energies are those of the tissue, before they
/// are multiplied by SceneForceLaw::force_scale.
struct CuttingReport {
  DeviceCoupling coupling;
  double force_scale = 1;
  /// `tip_max_N`: largest RecordingRow::tip_N. `tissue_max_N`: largest force of the
  /// tissue on the plate.
  double tip_max_N = 0, tissue_max_N = 0;
  BoneEnergyAccount energy;             ///< energies after the last tick
  std::uint64_t unconverged_ticks = 0;  ///< ticks in which Newton's method did not converge
  int steps_max = 0;                    ///< largest number of Newton steps in a tick
  std::uint64_t side_cuts = 0;          ///< holes requested where the shaft pushed a wall aside
};

class CuttingForceLaw final : public ForceLaw {
 public:
  /// Creates the law. The coupling is chosen for one pose of the plate: the plate is level, and the
  /// tip is on the topmost sheet at the scene's anchor (over_anchor() in runtime/haptics/sheet.h).
  /// Errors: those of make_bone_volume(), with the asset's path before each message; kRefused if
  /// the coupling is not passive at the rate (may_start()).
  static Result<std::unique_ptr<CuttingForceLaw>> make(const ForceLawSetup& setup);

  FaultDetail update(const ForceLawInput& input, ContactOutput& output) noexcept override;
  void reset_motion() noexcept override;
  void finish_tick(RecordingRow& row) noexcept override;
  double retract_distance_m(std::span<const Sheet* const> sheets,
                            const Pose& T_device_plate) const noexcept override;
  bool is_passive() const noexcept override { return true; }

  std::string describe() const override;
  std::string stability_warning() const override {
    return runtime::stability_warning(report_.coupling);
  }
  TipForce tip_force(std::size_t index, const Sheet& sheet) const override;
  SummarySection summary() const override;

  const CuttingReport& report() const noexcept { return report_; }

 private:
  CuttingForceLaw(const ForceLawSetup& setup, BoneVolume bone, const DeviceCoupling& coupling);

  Pose predicted_pose(const ForceLawInput& input) const noexcept;
  Eigen::Vector3d tip_from_plate_m() const noexcept;

  BoneVolume bone_;
  BoneContactState state_;
  ContactState contact_;  ///< requested and pending holes of the sheets
  SceneForceLaw law_;
  double rate_Hz_;
  bool has_unused_damping_ = false;  ///< a tissue has damping_N_s_per_m, which this law ignores
  double last_force_N_ = 0;          ///< force on the tip in the previous tick
  CuttingReport report_;
};

Result<std::unique_ptr<ForceLaw>> make_cutting_law(const ForceLawSetup& setup);

}  // namespace trocar::runtime
