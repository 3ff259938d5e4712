// SPDX-License-Identifier: Apache-2.0
// A dry run: a session over the scene with the simulated device, in virtual time and without
// outputs (`trocar-run --check`). Its result is exactly that of a session in virtual time with
// the same options.
// Tests: tests/e2e/scene_check_e2e_test.py
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/fault_words.h"
#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/checking/contact_feel.h"
#include "runtime/contact/sheet.h"
#include "runtime/device/hand_device.h"
#include "runtime/session/session.h"

namespace trocar::runtime {

/// A device as the checks of a scene need it.
struct DeviceToCheck {
  const DeviceSpecification& specification;
  /// Makes a simulated device of this kind, held by the scene's hand and ready for its first tick.
  /// Errors: (refused) the device cannot be where the hand begins.
  std::function<Result<std::shared_ptr<HandDevice>>(const Scene& scene)> simulate;
  /// Adapts the session's options, such as the coupling, to a proposed scene. Empty: they do not depend on the scene.
  std::function<void(const Scene& scene, SessionOptions& options)> set_options = {};
};

/// Largest number of ticks of a dry run, a minute at 1 kHz, so that it takes a few seconds at most.
inline constexpr std::uint64_t kMaxDryRunTicks = 60'000;

/// Result for one sheet.
struct SheetDryRun {
  bool touched = false;       ///< the sheet was loaded or punctured
  double touched_t_s = 0;     ///< time at which it was first loaded or punctured
  double loaded_t_s = 0;      ///< last time at which it was loaded
  double force_max_N = 0;     ///< largest force along z while it was loaded
  double punctured_t_s = -1;  ///< time of the first puncture; -1: none
  bool missed = false;        ///< the tool passed it where it has too little material
};

struct DryRun {
  std::uint64_t ticks = 0;          ///< number of ticks done
  std::uint64_t session_ticks = 0;  ///< number of ticks of the whole session
  /// True if the dry run ended before the session would, and without a fault.
  bool is_shortened() const noexcept { return ticks < session_ticks && fault == Fault::kNone; }
  FaultDetail fault;
  double fault_t_s = 0;
  RecordingRow at_fault;  ///< row of the tick in which the fault was found
  double tip_lowest_m = 0;
  std::vector<SheetDryRun> sheets;  ///< results in the order of the sheets given
  double force_max_N = 0, torque_max_Nm = 0;
  std::uint64_t scaled_ticks = 0;   ///< ticks in which the motors could not render the whole wrench
  double scale_min = 1;             ///< smallest fraction of a wrench that was rendered
  double scaled_t_s = 0;            ///< time of the first such tick
  ContactFeel feel;                 ///< figures of the contact that a hand would notice
  std::optional<Error> hole_error;  ///< error of the first hole that could not be cut
};

/// The result of several dry runs, in each of which the hand lets go at another time. Time and speed are those of the run in which the
/// plate was fastest afterwards.
struct LetGoTrial {
  int moments = 0;
  double t_s = 0;         ///< time of letting go
  double distance_m = 0;  ///< largest motion of the plate in any of them
  double speed_m_per_s = 0;
  Fault fault = Fault::kNone;  ///< a fault after letting go in any of them, or none
};

inline constexpr int kLetGoMoments = 10;
inline constexpr double kLetGoAfter_s = 0.4;
/// Does kLetGoMoments dry runs in which the hand lets go: one at the largest force along z, the others at even intervals of
/// the contact of `dry_run`. Each ends kLetGoAfter_s after the hand has let go. None: `dry_run` has no contact, or a fault.
Result<std::optional<LetGoTrial>> try_letting_go(
    const Scene& scene, const DeviceToCheck& device,
    const std::vector<std::unique_ptr<const Sheet>>& sheets, const SessionOptions& options,
    const DryRun& dry_run);

/// Runs a dry run. `options` are those of the session. Errors: those of DeviceToCheck::simulate;
/// (refused) with the force law `network`, NetworkPrefetch::make() refuses a tissue or the tool.
Result<DryRun> run_dry_run(const Scene& scene, const DeviceToCheck& device,
                           const std::vector<std::unique_ptr<const Sheet>>& sheets,
                           const SessionOptions& options);

}  // namespace trocar::runtime
