// SPDX-License-Identifier: Apache-2.0
// Checks a scene (`trocar-run --check`): its requirements, the hand's path, the workspace of the tip,
// a dry run, and warnings of what will go wrong.
//
// There is no warning exactly if
//  1. a session with the simulated device, in virtual time and with the same options, ends without a
//     fault, and every hole in it can be cut;
//  2. every slice is loaded in that session;
//  3. the motors render every wrench in full;
//  4. each slice is fitted by one of the scene's tissues, or the scene has a `tissue` for the
//     rest (tissue_assignment.h);
//  5. the upright plate's tip can reach the target of the scene's goals, if there is one.
// If the session has more than kMaxDryRunTicks, the dry run ends there (dry_run.h). After that only
// the path of the hand is evaluated, as if the tool followed it exactly: there is a warning if the
// path exceeds a limit or misses a slice.
// Tests: tests/e2e/scene_check_e2e_test.py
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/device_description.h"
#include "formats/session/scene.h"
#include "runtime/checking/scene_requirements.h"
#include "runtime/checking/tissue_assignment.h"
#include "runtime/contact/sheet.h"
#include "runtime/session/session.h"

namespace trocar::runtime {

struct SceneCheck {
  std::string text;                   ///< lines
  std::vector<std::string> warnings;  ///< each a line with position, value, limit and advice
};

/// `sheets` come from place_slices(), `tissues` from choose_tissues(); `options` are the session's.
/// Refused: with the force law `network`, a tissue or tool for which calibration finds no membrane;
/// SessionOptions::stop was set meanwhile.
Result<SceneCheck> check_scene(const Scene& scene, const DeviceDescription& device,
                               const std::vector<std::unique_ptr<const Sheet>>& sheets,
                               const std::vector<SliceTissue>& tissues, const LoadedBytes& bytes,
                               const SessionOptions& options);

}  // namespace trocar::runtime
