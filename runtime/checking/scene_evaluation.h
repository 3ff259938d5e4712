// SPDX-License-Identifier: Apache-2.0
// Computes the figures from which scene_check.h makes the text and the warnings of a check.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "runtime/checking/dry_run.h"
#include "runtime/checking/hand_path.h"
#include "runtime/devices/tip_workspace.h"

namespace trocar::runtime {

/// Reason why the tool does not touch a slice.
enum class Miss : std::uint8_t {
  kTouched,      ///< touched, or unknown because the dry run had a fault or ended too early
  kBeginsBelow,  ///< the path begins below the slice and never comes from above
  kStaysAbove,   ///< the path never goes below the slice
  kTooLate,      ///< the path goes below the slice only after the session's end
  kLetGo,        ///< the path goes below the slice only after the hand has let go
  kMissed,       ///< too little material is under the tool where the path crosses the slice
  kHeld,         ///< forces keep the tool from following the path down to the slice
};

/// The crossing of the hand's path with a sheet, and why the tool does not touch this sheet.
struct SheetView {
  /// The first crossing before the hand lets go that has enough material under the tool. If there
  /// is no such crossing, the first of all crossings. None: the path does not cross the sheet.
  std::optional<SheetCrossing> crossing;
  Miss miss = Miss::kTouched;
};

/// Everything from which the text and the warnings of a check are made.
struct SceneEvaluation {
  const Scene& scene;
  const DeviceSpecification& device;
  const std::vector<std::unique_ptr<const Sheet>>& sheets;
  const SessionOptions& options;
  Tool tool{};
  HandTrajectory path{};
  double end_s = 0;                 ///< time of the last tick
  double let_go_s = 0;              ///< time until which the hand holds the tool, at most end_s
  PathReport report{};              ///< the path up to let_go_s
  std::optional<DryRun> dry_run{};  ///< none: the session cannot start, or the hand is live
  /// Force law `cutting` only: the result of try_letting_go(), if the dry run had contact
  /// and no fault.
  std::optional<LetGoTrial> let_go{};
  std::vector<SheetView> views{};

  /// Returns true if the dry run had a fault, or if there is no dry run.
  bool has_fault() const { return !dry_run || dry_run->fault != Fault::kNone; }
  /// Time at which the dry run ended; 0: there was none.
  double dry_run_end_s() const {
    return dry_run ? static_cast<double>(dry_run->ticks) / options.rate_Hz : 0;
  }
};

/// Follows the path and does a dry run. With a live hand there is no dry run, and SheetView::miss
/// is kTouched for every sheet. The arguments must outlive the result. Errors: those of
/// run_dry_run(); kRefused if SessionOptions::stop was set. If the device cannot reach the hand's
/// first pose, this is no error, but the result has no dry run.
Result<SceneEvaluation> evaluate_scene(const Scene& scene, const DeviceToCheck& device,
                                       const std::vector<std::unique_ptr<const Sheet>>& sheets,
                                       const SessionOptions& options);

/// Returns the force at which a sheet is punctured, as the device renders it. None: the force law
/// `cutting` cuts the sheet's tissue (Tissue::cut), which breaks at the strength under the tool.
std::optional<double> rendered_threshold_N(const SceneEvaluation& e, std::size_t index);

/// Returns a text such as "x -0.050 to 0.050, y -0.050 to 0.050 m".
std::string describe_rectangle(const WorkspaceRectangle& rectangle);

}  // namespace trocar::runtime
