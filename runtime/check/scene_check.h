// SPDX-License-Identifier: Apache-2.0
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
//     scene (choose_tissues()): one of `tissues`, or `tissue`, which is for all other slices.
//  5. If the scene's goals have a target, the tip can reach the target, to within the target's
//     radius in x and y, while the plate is not tilted.
//  6. The quantities of ContactFeel are within these limits, so that the contact feels like
//     bone. No force alternates from tick to tick by more than 5 N. With the force law `cutting`,
//     three more conditions hold. While the cutting front bears force, the plate's tip (defined at
//     ContactFeel::past_front) is at most 3 mm below the front. The front moves by at most 1.5 mm
//     in a tick. If the hand lets go, at any of ten moments of the contact, no fault follows, and
//     the plate moves by at most 3 mm, at no more than 0.25 m/s.
//  7. ForceLaw::contact_warning() has no reason to warn: a contact at rest is quiet. (A stiffness that
//     the device cannot hold is an error.)
//
// If the scene has a live hand, the person's motion is not known, and there is no dry run. There
// is then no warning if and only if a session can start, the live hand can reach the height of
// every slice (LiveHandLimits), and items 4, 5 and 7 hold.
//
// If the session has more than kMaxDryRunTicks ticks, the dry run ends after that number of ticks
// (dry_run.h), and later times are judged by the path alone. Item 2 then holds for a slice, too, if
// the path first crosses the slice's material after the end of the dry run.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/base/result.h"
#include "formats/session/scene.h"
#include "runtime/check/dry_run.h"
#include "runtime/haptics/sheet.h"
#include "runtime/haptics/slice_field.h"
#include "runtime/session/session_options.h"

namespace trocar::runtime {

/// Returns a text such as "slice 3" or "slices 0-46, 50", with each slice once, in ascending order.
std::string name_slices(std::vector<int> slices);

struct SliceTissue {
  int slice = 0;  ///< slice index in the asset
  double z_m = 0;
  TissueChoice choice;
};

/// Returns the tissue of every slice of the scene, the topmost first as in place_slices(). Slices
/// that the asset does not have are left out.
std::vector<SliceTissue> choose_tissues(const Scene& scene, const Asset& asset);

/// Returns a text such as: tissue "bone": mean HU 412.
std::string describe_choice(const Scene& scene, const TissueChoice& choice);

/// Returns a warning if some slice gets Trocar's default tissue although the scene gives tissues by
/// label or HU. That happens if none of these tissues fits the slice, and the scene has no `tissue`
/// for the remaining slices.
std::optional<std::string> warn_of_unfitting(const Scene& scene,
                                             const std::vector<SliceTissue>& tissues);

struct LoadedBytes {
  std::uint64_t asset = 0;  ///< size of the asset's file
  std::uint64_t read = 0;   ///< number of bytes of the file that were read
  std::size_t asset_slices = 0;
};

struct SceneCheck {
  std::string text;                   ///< the lines of the check
  std::vector<std::string> warnings;  ///< one line each, with position, value, limit and advice
  std::optional<DryRun> dry_run;      ///< none: the session cannot start, or the hand is live
};

/// kUntilWarned: if the dry run gives a warning, the hand's letting go, which takes several times as
/// long, is not tried; and it is tried only until it gives one. Whether there is a warning is as
/// with kWhole.
enum class CheckExtent { kWhole, kUntilWarned };

/// Checks a scene. `sheets`: result of place_slices(). `tissues`: result of choose_tissues().
/// `options`: the options of the session. If the device cannot reach the hand's first pose, this is
/// a warning and no error. Errors: those of run_dry_run(); kDeviceFault if SessionOptions::stop is
/// set during the check.
Result<SceneCheck> check_scene(const Scene& scene, const DeviceToCheck& device,
                               const std::vector<std::unique_ptr<const Sheet>>& sheets,
                               const std::vector<SliceTissue>& tissues, const LoadedBytes& bytes,
                               const SessionOptions& options,
                               CheckExtent extent = CheckExtent::kWhole);

}  // namespace trocar::runtime
