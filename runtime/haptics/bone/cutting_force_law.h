// SPDX-License-Identifier: Apache-2.0
// The force law `cutting`. The tool cuts through one bone volume (bone_volume.h). The tool
// in the bone is connected to the plate by a spring, or is rigidly fixed to the plate
// (device_coupling.h). The law itself is passive (cutting_law.h, contract 1).
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "formats/base/result.h"
#include "runtime/haptics/bone/bone_contact.h"
#include "runtime/haptics/bone/device_coupling.h"
#include "runtime/haptics/force_law.h"

namespace trocar::runtime {

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
  /// the coupling is not passive at the rate (is_passive() in device_coupling.h).
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
