// SPDX-License-Identifier: Apache-2.0
// The judgement of a scene (`trocar-run --check`): what it needs, where the hand's path goes, what
// the tip can reach, what a trial session did, and warnings of what will go wrong.
//
// There is no warning exactly if
//  1. the session with the simulated device, in virtual time and with the same options, ends
//     without a fault, and every hole in it can be cut;
//  2. every slice bears force in it;
//  3. the motors render every wrench in full;
//  4. no slice gets a tissue by default because none of the scene's tissues fits (tissue_report.h);
//  5. the upright plate's tip can reach the target of the scene's goals, if it has one.
// A session of more than kMaxTrialTicks is tried to there (trial.h). From there on the path counts,
// with a hand that the tool follows exactly: a place beyond a limit, or a slice that it does not
// go through, is warned of.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/device_description.h"
#include "formats/session/scene.h"
#include "runtime/contact/sheet.h"
#include "runtime/session/scene_needs.h"
#include "runtime/session/session.h"
#include "runtime/session/tissue_report.h"

namespace trocar::runtime {

struct SceneCheck {
  std::string text;                   ///< lines
  std::vector<std::string> warnings;  ///< each a line: place, value, limit, what to do
};

/// `sheets` as from place_slices, `tissues` as from choose_tissues; `options` as for the session.
/// Refused: with the force law `network`, a tissue or tool for which calibration finds no membrane;
/// SessionOptions::stop was set meanwhile.
Result<SceneCheck> check_scene(const Scene& scene, const DeviceDescription& device,
                               const std::vector<std::unique_ptr<const Sheet>>& sheets,
                               const std::vector<SliceTissue>& tissues, const LoadedBytes& bytes,
                               const SessionOptions& options);

}  // namespace trocar::runtime
