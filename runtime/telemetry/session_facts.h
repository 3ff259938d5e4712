// SPDX-License-Identifier: Apache-2.0
// The facts that do not change during a session, as JSON for the programs that read its
// shared memory (formats/session/telemetry.md).
// Tests: tests/runtime/session/live_session_test.cpp
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "formats/session/device_description.h"
#include "formats/session/scene.h"
#include "runtime/control/limits.h"
#include "runtime/workers/remesher.h"

namespace trocar::runtime {

/// Facts that only the program knows.
struct TelemetryOptions {
  std::filesystem::path file;  ///< name of the link to the shared memory
  std::string scene_file, device, recovery;
  std::vector<std::string> tissue_of_sheet;  ///< names, the topmost first; empty: no name
};

/// Facts that come from the options of the session.
struct PublishedSession {
  double rate_Hz = 1000, duration_s = 1;
  std::string clock;  ///< "real", "virtual" or "replay"
  std::optional<std::filesystem::path> record;
  SafetyLimits limits;
};

std::string session_facts(const Scene& scene, const DeviceDescription& description,
                          const Remesher& remesher, const TelemetryOptions& options,
                          const PublishedSession& session);

}  // namespace trocar::runtime
