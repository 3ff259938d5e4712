// SPDX-License-Identifier: Apache-2.0
// The two force laws that treat each slice as a separate elastic sheet. With `hooke`, the stiffness
// of a sheet is the tissue's spring constant. With `network`, the stiffness is that of the sheet's
// spring network under the tool, and a prefetch worker computes it. In all other respects the two
// laws are the same: runtime/contact/puncture.h defines contact and puncture, and a virtual
// coupling (runtime/contact/virtual_coupling.h) can connect the tool to the plate.
#pragma once

#include <memory>
#include <string>

#include "formats/base/result.h"
#include "runtime/contact/force_law.h"
#include "runtime/force_law/network_prefetch.h"

namespace trocar::runtime {

/// The force law `hooke`, and the common part of `hooke` and `network`.
class SheetLaw : public ForceLaw {
 public:
  /// `force_scale`: SceneForceLaw::force_scale.
  explicit SheetLaw(const ContactModel& model, const CouplingOptions& coupling = {},
                    double force_scale = 1)
      : model_(model), coupling_options_(coupling), force_scale_(force_scale) {}

  FaultDetail update(const ForceLawInput& input, ContactOutput& output) noexcept override;
  void reset_motion() noexcept override;
  void finish_tick(RecordingRow& row) noexcept override;
  double retract_distance_m(std::span<const Sheet* const> sheets,
                            const Pose& T_device_plate) const noexcept override;
  std::string describe() const override;
  TipForce tip_force(std::size_t /*index*/, const Sheet& sheet) const override {
    return {sheet.tissue.stiffness_N_per_m, sheet.tissue.threshold_N, force_scale_};
  }

  ContactModel& model() noexcept { return model_; }
  CouplingOptions& coupling_options() noexcept { return coupling_options_; }
  ContactState& contact() noexcept { return contact_; }
  const ContactState& contact() const noexcept { return contact_; }

 private:
  ContactModel model_;
  CouplingOptions coupling_options_;
  double force_scale_;
  ContactState contact_;
  CouplingState coupling_;
  /// Position of the proxy minus that of the tool on the plate, in the contact of the last update();
  /// zero after reset_motion().
  Eigen::Vector3d proxy_shift_m_ = Eigen::Vector3d::Zero();
  double last_force_N_ = 0;              ///< tip force in the previous tick
  std::int32_t last_active_sheet_ = -1;  ///< index of the sheet that exerted last_force_N_
};

/// The force law `network`.
class NetworkLaw final : public SheetLaw {
 public:
  NetworkLaw(const ContactModel& model, const CouplingOptions& coupling, const SceneForceLaw& law,
             std::unique_ptr<NetworkPrefetch> prefetch)
      : SheetLaw(model, coupling, law.force_scale), law_(law), prefetch_(std::move(prefetch)) {}

  PrefetchWorker* prefetch_worker() noexcept override { return prefetch_.get(); }
  std::string describe() const override;
  std::string describe_sheet(std::size_t index, const Sheet& sheet,
                             const Pose& T_device_plate) override;
  SummarySection summary() const override;

  const PrefetchReport& prefetch_report() const noexcept { return prefetch_->report(); }

 private:
  SceneForceLaw law_;
  std::unique_ptr<NetworkPrefetch> prefetch_;
};

Result<std::unique_ptr<ForceLaw>> make_hooke_law(const ForceLawSetup& setup);

/// Errors: those of NetworkPrefetch::make().
Result<std::unique_ptr<ForceLaw>> make_network_law(const ForceLawSetup& setup);

}  // namespace trocar::runtime
