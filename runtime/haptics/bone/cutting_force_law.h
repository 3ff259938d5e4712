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
#include "runtime/haptics/contact_design.h"
#include "runtime/haptics/force_law.h"

namespace trocar::runtime {

// Chooses the coupling between the device's plate and the tool in the bone. All forces and
// stiffnesses of this comment are rendered ones, with the force scale.
//
// The coupling is a spring that stiffens with its force F (StiffeningSpring), because a large force
// hides more noise: K(F) = quiet_N(F) / s, where s = 3.3 c sigma + kSeveral p delta is the largest
// step of the led position at rest (contact_design.h). So K is quiet_N(0) / s up to 10 N and grows
// with F up to a largest tangent K1. K1 is at most the stable stiffness; among smaller ones, which
// allow another estimator and with it a smaller s, the one is chosen with the least extension at
// kPress_N. Noise costs depth: the spring extends, by extension_m(), before bone gives way.
//
// Contract:
//  1. SceneForceLaw::axis says whether the tool is rigidly fixed to the plate or connected by a
//     coupling spring. If the scene leaves the choice open (kAuto), the tool is rigid if the tissue
//     can never be stiffer than the coupling is at small forces, in translation and in rotation.
//  2. A rigid tool needs K tau^2 / M of at most kMaxRigidShare, with the stiffness K of the tissue
//     in its stiffest direction, and likewise in rotation, with the square of the lever, which is
//     the distance from the plate's origin to the tip plus 5 cm. Above, kAuto gives a coupling and
//     kRigid is refused.
//  3. If the scene states a stiffness of the coupling, the coupling is linear with it, or with the
//     stable stiffness if that is less.
//  4. Whatever the scene says, the rendered stiffness at the tip never exceeds the largest
//     stiffness that the device states (stiffness_max_N_per_m()), nor the operator's limit
//     (StiffnessLimits). If a rigid tool would exceed one of these two limits, the tool gets a
//     coupling even if the scene declares it rigid.
//  5. In rotation the spring is that of translation at the lever max(distance of the tip from the
//     plate's origin, 5 cm), within what is stable there.
//  6. The coupling's largest force is the one that the device can render along the tool at its peak
//     torques, divided by the force scale.

/// Largest K tau^2 / M of a rigid tool. The first hand to shake was at 0.12 (tests).
inline constexpr double kMaxRigidShare = 0.125;
/// Several of sixteen encoders can step in one tick: measured, relative to a single one.
inline constexpr double kSeveral = 1.5;
/// Force of a firm push, for which the coupling is chosen.
inline constexpr double kPress_N = 50;
/// Speeds along the force at which the plate's escape is damped: from `from` on the wrench fades,
/// and at `from` + kEscapeWidth_m_per_s it is zero. `from` is kEscape_m_per_s, above a hand's
/// tremor, and kEscapeSigmas deviations of the estimated speed at rest.
inline constexpr double kEscape_m_per_s = 0.02, kEscapeWidth_m_per_s = 0.05, kEscapeSigmas = 6;

struct DeviceCoupling {
  CuttingCoupling coupling;  ///< before the force scale is multiplied
  ContactDesign design;
  double force_scale = 1;
  /// Largest tissue force along the tool that the device can render; 0: the device cannot be at the
  /// given pose.
  double max_N = 0;
  bool is_at_ceiling = false;  ///< the stiffness was reduced to design.device_N_per_m
  /// By how much the coupling is extended at a rendered force; 0 if the tool is rigid.
  double extension_m(double force_N) const noexcept;
};

/// Chooses the coupling for one pose of the plate, for example with the tip on top of the bone.
/// Errors: kRefused if a rigid tool is too stiff (contract 2).
Result<DeviceCoupling> choose_coupling(const BoneVolume& bone, const SceneForceLaw& law,
                                       const DeviceSpecification& device,
                                       const Pose& T_device_plate, double rate_Hz,
                                       const StiffnessLimits& limits = {});

/// Returns the choice as lines of text, for `check`.
std::string describe(const DeviceCoupling& chosen, const SceneForceLaw& law);

// The force law `cutting`. The tool cuts through one bone volume (bone_volume.h). The tool
// in the bone is connected to the plate by a spring, or is rigidly fixed to the plate
// (below). The law itself is passive (cutting_law.h, contract 1).

/// Figures of a session, for its summary. Forces and energies are those of the tissue, before they
/// are multiplied by SceneForceLaw::force_scale.
struct CuttingReport {
  DeviceCoupling coupling;
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
  /// Errors: those of make_bone_volume(), with the asset's path before each message; those of
  /// choose_coupling().
  static Result<std::unique_ptr<CuttingForceLaw>> make(const ForceLawSetup& setup);

  FaultDetail update(const ForceLawInput& input, ContactOutput& output) noexcept override;
  void reset_motion() noexcept override;
  void finish_tick(RecordingRow& row) noexcept override;
  double retract_distance_m(std::span<const Sheet* const> sheets,
                            const Pose& T_device_plate) const noexcept override;

  std::string describe() const override;
  PoseEstimator estimator() const noexcept override { return report_.coupling.design.estimator; }
  std::string contact_warning() const override;
  TipForce tip_force(std::size_t index, const Sheet& sheet) const override;
  SummarySection summary() const override;

  const CuttingReport& report() const noexcept { return report_; }

 private:
  CuttingForceLaw(const ForceLawSetup& setup, BoneVolume bone, const DeviceCoupling& coupling);

  void damp_escape(const Twist& twist_device, ContactOutput& output) noexcept;

  BoneVolume bone_;
  BoneContactState state_;
  ContactState contact_;  ///< requested and pending holes of the sheets
  SceneForceLaw law_;
  double escape_m_per_s_ = kEscape_m_per_s;
  bool has_unused_damping_ = false;  ///< a tissue has damping_N_s_per_m, which this law ignores
  double last_force_N_ = 0;          ///< force on the tip in the previous tick
  CuttingReport report_;
};

Result<std::unique_ptr<ForceLaw>> make_cutting_law(const ForceLawSetup& setup);

}  // namespace trocar::runtime
