// SPDX-License-Identifier: Apache-2.0
// The requirements of a scene, a part of `trocar-run check`: the bytes that are loaded and kept
// in memory, the motor torques that the tissues' threshold forces need and, with the force law
// `network`, the time to prepare the prefetched stiffness.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/scene.h"
#include "runtime/check/dry_run.h"
#include "runtime/check/needle_path.h"
#include "runtime/check/new_scene.h"
#include "runtime/device/hand_device.h"
#include "runtime/haptics/sheet.h"
#include "runtime/session/live_hand.h"
#include "runtime/session/pose_session.h"
#include "runtime/session/session.h"
#include "runtime/session/session_options.h"

namespace trocar::runtime {

struct LoadedBytes {
  std::uint64_t asset = 0;  ///< size of the asset's file
  std::uint64_t read = 0;   ///< number of bytes of the file that were read
  std::size_t asset_slices = 0;
};

/// Texts about one slice, without the last line feed.
struct SliceRequirements {
  std::string mesh;   ///< height, size and tissue
  std::string force;  ///< torques and stiffness at one pose of the tool
};
struct SceneRequirements {
  std::string scene;  ///< lines about the whole scene
  std::vector<SliceRequirements> slices;
  /// Why the loop may oscillate or give energy to the hand; empty: no such reason is known.
  std::string stability_warning;
};

/// Describes the requirements. `sheets`: result of place_slices(). `T_device_plate`:
/// for each sheet, a pose of the plate at which the tool touches this sheet. Errors:
/// those of make_force_law().
Result<SceneRequirements> describe_requirements(
    const Scene& scene, const DeviceSpecification& device,
    const std::vector<std::unique_ptr<const Sheet>>& sheets,
    const std::vector<Pose>& T_device_plate, const LoadedBytes& bytes,
    const SessionOptions& options);

// Computes the figures from which scene_check.h makes the text and the warnings of a check.

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

// The warnings of `trocar-run check`. To add a warning, write a function in scene_warnings.cpp
// and call it in find_warnings().

/// Returns the warnings. Each warning is a line with position, value, limit and advice.
std::vector<std::string> find_warnings(const SceneEvaluation& evaluation,
                                       const std::vector<SliceTissue>& tissues);

/// Returns the warnings of a scene with a live hand. `hand`: result of live_hand_limits().
std::vector<std::string> find_live_hand_warnings(const SceneEvaluation& evaluation,
                                                 const std::vector<SliceTissue>& tissues,
                                                 const Result<LiveHandLimits>& hand);

// Checks a scene before a session (`trocar-run check`). The text of the check describes the
// scene's requirements, the tip's workspace, the hand's path and a dry run. Warnings describe
// problems that a session would have.
//
// There is no warning if and only if all items of this list hold:
//  1. The dry run, a session with the simulated device in virtual time and with the same options,
//     ends without a fault, and every hole that it requests can be cut.
//  2. Every slice is touched in the dry run. A slice is touched if it bears force or is punctured.
//     In a bone volume (force law `cutting`) it is enough that one slice is touched. Contact with a
//     soft layer does not count.
//  3. The device renders every wrench of the dry run in full.
//  4. If the scene chooses tissues by label or HU (`tissues`), every slice gets a tissue of the
//     scene (tissue_assignment.h): one of `tissues`, or `tissue`, which is for all other slices.
//  5. If the scene's goals have a target, the tip can reach the target, to within the target's
//     radius in x and y, while the plate is not tilted.
//  6. The quantities of contact_feel.h are within these limits, so that the contact feels like
//     bone. No force alternates from tick to tick by more than 5 N. With the force law `cutting`,
//     three more conditions hold. While the cutting front bears force, the plate's tip (defined at
//     ContactFeel::past_front) is at most 3 mm below the front. The front moves by at most 1.5 mm
//     in a tick. If the hand lets go, at any of ten moments of the contact, no fault follows, and
//     the plate moves by at most 3 mm, at no more than 0.25 m/s.
//  7. With the law `cutting`, stability_warning() (device_coupling.h) has no reason to warn: the
//     rate of the loop is so high that the loop is known to give no energy to the hand. (If the
//     rendered stiffness is too large for the rate, there is no check: is_passive() is an error.)
//
// If the scene has a live hand, the person's motion is not known, and there is no dry run. There
// is then no warning if and only if a session can start, the live hand can reach the height of
// every slice (LiveHandLimits), and items 4, 5 and 7 hold.
//
// If the session has more than kMaxDryRunTicks ticks, the dry run ends after that number of ticks
// (dry_run.h). For later times only the path of the hand is evaluated, as if the tool followed the
// hand exactly. Item 1 then means also that this path exceeds no limit. Item 2 then holds for a
// slice, too, if the path first crosses the slice's material after the end of the dry run.

struct SceneCheck {
  std::string text;                   ///< the lines of the check
  std::vector<std::string> warnings;  ///< one line each, with position, value, limit and advice
};

/// Checks a scene. `sheets`: result of place_slices(). `tissues`: result of choose_tissues().
/// `options`: the options of the session. Errors: those of evaluate_scene() (scene_evaluation.h)
/// and describe_requirements(), such as kRefused if SessionOptions::stop is set during the check.
Result<SceneCheck> check_scene(const Scene& scene, const DeviceToCheck& device,
                               const std::vector<std::unique_ptr<const Sheet>>& sheets,
                               const std::vector<SliceTissue>& tissues, const LoadedBytes& bytes,
                               const SessionOptions& options);

}  // namespace trocar::runtime
