// SPDX-License-Identifier: Apache-2.0
// The options of trocar-run. Parsing fills RunArguments, and in it the session's own options.
#pragma once

#include <array>
#include <optional>
#include <string>

#include "formats/base/result.h"
#include "formats/session/procedures.h"
#include "formats/session/scene.h"
#include "formats/session/trainee.h"
#include "runtime/session/open_device.h"
#include "runtime/session/session_options.h"

namespace CLI {  // NOLINT(readability-identifier-naming): CLI11's
class App;
}  // namespace CLI

namespace trocar::runtime {

inline constexpr const char* kProgram = "trocar-run";
inline constexpr double kDefaultRate_Hz = 1000;
/// Default of --late-ticks-in-row for a device with motors: if this number of deadlines is missed
/// in a row, a fault is raised.
inline constexpr int kDefaultLateTicks = 3;

/// The values of all options; a command declares those that it uses. An empty text: not given.
struct RunArguments {
  // The scene, and what replaces its own.
  std::string scene, asset, procedure;
  std::optional<ForceLawKind> force_law;
  Strength strength = Strength::kMedian;
  std::optional<double> rate_Hz, duration_s, force_scale;
  // The device.
  std::string device{kDefaultDevice}, key_file, description;
  bool is_simulated = false;
  std::optional<double> force_limit_N;
  /// If this number of deadlines is missed in a row, a fault is raised; 0: no fault is raised.
  /// None: kDefaultLateTicks for a device with motors, 0 for a simulated device.
  std::optional<int> late_ticks_in_row;
  // The session.
  bool is_check = false;  ///< the command is check
  SessionOptions session;
  Trainee trainee;
  std::string replay, live, summary, session_report, meshes, frames, hand_path;
  bool quiet = false, is_strict = false;
  // Of new-scene, history and procedures.
  std::string input, output;
  double push_N = 0;                                         ///< of test
  std::optional<std::array<double, 3>> entry_mm, target_mm;  ///< in the patient's frame (LPS)
  bool has_live_hand = false;
};

/// The value of --recover.
const char* to_string(RecoveryPolicy recovery);

// Each function declares the options of one command. SCENE is not required by the first, because
// CLI11 would ask for it before a command, too.
void declare_run(CLI::App& app, RunArguments& arguments);
void declare_check(CLI::App& app, RunArguments& arguments);
void declare_replay(CLI::App& app, RunArguments& arguments);
void declare_test(CLI::App& app, RunArguments& arguments);
void declare_new_scene(CLI::App& app, RunArguments& arguments);
void declare_history(CLI::App& app, RunArguments& arguments);
void declare_procedures(CLI::App& app, RunArguments& arguments);

/// Checks what depends on several options or on the device. Errors: kUsage.
Result<void> check_options(const RunArguments& arguments);

/// The options of the session, with the limits that follow from the device.
SessionOptions session_options(const RunArguments& arguments);

}  // namespace trocar::runtime
