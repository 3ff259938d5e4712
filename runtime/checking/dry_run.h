// SPDX-License-Identifier: Apache-2.0
// A dry run: a session over the scene with the simulated device, in virtual time, which writes no
// files (`trocar-run check`). Up to kMaxDryRunTicks ticks, the result of a dry run is exactly
// that of a session in virtual time with the same options.
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

/// The device with which a scene is checked.
struct DeviceToCheck {
  const DeviceSpecification& specification;
  /// Makes a simulated device of this kind, held by the scene's hand and ready for its first tick.
  /// Errors: kRefused if the device cannot reach the pose at which the hand begins.
  std::function<Result<std::shared_ptr<HandDevice>>(const Scene& scene)> simulate;
  /// Adapts the session's options, such as the coupling, to a proposed scene. Empty: the options do
  /// not depend on the scene.
  std::function<void(const Scene& scene, SessionOptions& options)> set_options = {};
};

/// Largest number of ticks of a dry run: a minute at 1 kHz. So a dry run takes at most a few
/// seconds.
inline constexpr std::uint64_t kMaxDryRunTicks = 60'000;

/// Result of a dry run for one sheet.
struct SheetDryRun {
  bool touched = false;    ///< the sheet bore force or was punctured
  double touched_t_s = 0;  ///< time at which the sheet first bore force or was punctured
  double loaded_t_s = 0;   ///< last time at which the sheet bore force
  /// The larger of two forces: the largest wanted force along z while the sheet bore force, and the
  /// largest rendered force on the tip in a tick before a puncture of the sheet.
  double force_max_N = 0;
  double punctured_t_s = -1;  ///< time of the first puncture; -1: none
  bool missed = false;        ///< the tool passed the sheet with too little material under the tool
};

struct DryRun {
  std::uint64_t ticks = 0;          ///< number of ticks done
  std::uint64_t session_ticks = 0;  ///< number of ticks of the whole session
  /// True if the dry run had no fault, but ended before the session would end.
  bool is_shortened() const noexcept { return ticks < session_ticks && fault == Fault::kNone; }
  FaultDetail fault;
  double fault_t_s = 0;
  RecordingRow at_fault;            ///< row of the tick in which the fault was found
  double tip_lowest_m = 0;          ///< lowest height of the tip before any fault
  std::vector<SheetDryRun> sheets;  ///< one result for each sheet, in the order of the argument
  /// Largest force delivered to the hand, and largest motor torque.
  double force_max_N = 0, torque_max_Nm = 0;
  std::uint64_t scaled_ticks = 0;   ///< ticks in which the device could not render the whole wrench
  double scale_min = 1;             ///< smallest fraction of the wrench rendered in these ticks
  double scaled_t_s = 0;            ///< time of the first of these ticks
  ContactFeel feel;                 ///< the contact as a hand would feel it
  std::optional<Error> hole_error;  ///< error of the first hole that could not be cut
};

/// The result of several dry runs, in each of which the hand lets go at another time.
struct LetGoTrial {
  int moments = 0;             ///< number of dry runs
  double t_s = 0;              ///< time of letting go in the run in which the plate became fastest
  double distance_m = 0;       ///< largest motion of the plate after letting go, over all runs
  double speed_m_per_s = 0;    ///< largest speed of the plate after letting go, over all runs
  Fault fault = Fault::kNone;  ///< the fault of the first run that had one, or none
};

inline constexpr int kLetGoMoments = 10;
inline constexpr double kLetGoAfter_s = 0.4;
/// Does kLetGoMoments dry runs in which the hand lets go during the contact that `dry_run` had. In
/// the first run the hand lets go at the largest force along z. In the other runs the hand lets go
/// at evenly spaced times of the contact. Each run ends kLetGoAfter_s after the hand has let go, or
/// at the session's end if that is earlier. Returns none if `dry_run` has a fault, or if `dry_run`
/// has no contact before the scene's hand lets go. Errors: those of run_dry_run(); kRefused if
/// SessionOptions::stop was set.
Result<std::optional<LetGoTrial>> try_letting_go(
    const Scene& scene, const DeviceToCheck& device,
    const std::vector<std::unique_ptr<const Sheet>>& sheets, const SessionOptions& options,
    const DryRun& dry_run);

/// Runs a dry run. `options`: the options of the session. Errors: those of DeviceToCheck::simulate
/// and of make_force_law().
Result<DryRun> run_dry_run(const Scene& scene, const DeviceToCheck& device,
                           const std::vector<std::unique_ptr<const Sheet>>& sheets,
                           const SessionOptions& options);

}  // namespace trocar::runtime
