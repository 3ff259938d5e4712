// SPDX-License-Identifier: Apache-2.0
// The facts that do not change during a session, such as its scene, device, rate and limits. They
// are written as JSON into the session's shared memory, for the programs that read this memory
// (formats/session/telemetry.md, section About).
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "formats/session/scene.h"
#include "runtime/control/limits.h"
#include "runtime/device/hand_device.h"
#include "runtime/workers/remesher.h"

namespace trocar::runtime {

class Recorder;

/// The facts about a live hand, which is a hand that a person moves. Its springs pull the tip to a
/// target. The target starts at start_tip_m and start_rotation_rad. While a person holds the tool,
/// the target stays in the box from min_m to max_m, and its rotation differs from the rotation at
/// the start by at most turn_max_rad. Frame: {B}.
struct PublishedHand {
  std::array<double, 3> min_m{}, max_m{}, start_tip_m{}, start_rotation_rad{};
  double stiffness_N_per_m = 0, rotation_stiffness_Nm_per_rad = 0;
  double speed_max_m_per_s = 0, rotation_rate_max_rad_per_s = 0, turn_max_rad = 0;
};

/// Facts that the program supplies.
struct TelemetryOptions {
  std::filesystem::path file;  ///< name of the link to the shared memory
  /// `device` and `recovery` are the values of the options --device and --recover. In a replay,
  /// `device` is "replay".
  std::string scene_file, device, recovery;
  std::vector<std::string> tissue_of_sheet;  ///< tissue names, topmost sheet first; "": no name
  std::optional<PublishedHand> hand = {};    ///< none: the session has no live hand
};

/// Facts that come from the options of the session.
struct PublishedSession {
  double rate_Hz = 1000, duration_s = 1;
  std::string clock;                            ///< "real", "virtual" or "replay"
  std::optional<std::filesystem::path> record;  ///< file of the recording; none: no recording
  bool counts_xray = false;  ///< the session accepts and counts X-ray shots and screening
  SafetyLimits limits;
  /// Writes `record` and outlives the publisher; null: no recording.
  const Recorder* recorder = nullptr;
};

/// Returns the facts as JSON text.
std::string session_facts(const Scene& scene, const DeviceSpecification& device,
                          const Remesher& remesher, const TelemetryOptions& options,
                          const PublishedSession& session);

}  // namespace trocar::runtime
