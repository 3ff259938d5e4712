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
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/scene.h"
#include "runtime/checking/dry_run.h"
#include "runtime/checking/scene_requirements.h"
#include "runtime/checking/tissue_assignment.h"
#include "runtime/contact/sheet.h"
#include "runtime/session/session.h"

namespace trocar::runtime {

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
