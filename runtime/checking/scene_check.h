// SPDX-License-Identifier: Apache-2.0
// Checks a scene (`trocar-run --check`): its requirements, the hand's path, the workspace of the tip,
// a dry run, and warnings of problems in a session.
//
// There is no warning if and only if all of these hold:
//  1. A session with the simulated device, in virtual time and with the same options, ends without a
//     fault, and every hole in it can be cut.
//  2. Every slice is loaded in that session.
//  3. The device renders every wrench in full.
//  4. One of the scene's tissues fits each slice, or the scene has a `tissue` for the
//     remaining slices (tissue_assignment.h).
//  5. If the scene's goals have a target, the tip of the upright plate can reach it.
//  6. Contact feels like bone: no force of more than 5 N alternates from tick to tick. With the law `cutting`, the
//     tip is at most 3 mm past the front that bears it, and the front moves at most 1.5 mm in a tick. A hand that
//     lets go at ten moments of the contact causes no fault, and the plate moves at most 3 mm and 0.25 m/s.
//  7. With the law `cutting`, the rendered stiffness is one that is passive (device_coupling.h).
// With a live hand nothing is known of what the person will do. There is no warning if and only if a session
// can start, every slice is within the hand's box, and 4, 5 and 7 hold.
// If the session has more than kMaxDryRunTicks ticks, the dry run ends there (dry_run.h). For later
// times only the path of the hand is evaluated, as if the tool followed it exactly: there is a
// warning if the path exceeds a limit or misses a slice.
// Tests: tests/runtime/checking/scene_check_test.cpp, tests/e2e/scene_check_e2e_test.py
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
  std::vector<std::string> warnings;  ///< lines with position, value, limit and advice
};

/// Checks a scene. `sheets`: result of place_slices(). `tissues`: result of choose_tissues().
/// `options`: those of the session. Errors: (refused) with the force law `network`,
/// NetworkPrefetch::make() refuses a tissue or the tool; SessionOptions::stop was set meanwhile.
Result<SceneCheck> check_scene(const Scene& scene, const DeviceToCheck& device,
                               const std::vector<std::unique_ptr<const Sheet>>& sheets,
                               const std::vector<SliceTissue>& tissues, const LoadedBytes& bytes,
                               const SessionOptions& options);

}  // namespace trocar::runtime
