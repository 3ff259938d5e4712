// SPDX-License-Identifier: Apache-2.0
// The values on the command line of trocar-run, and their checks.
#pragma once

#include <optional>
#include <string>

#include "formats/base/result.h"
#include "formats/session/trainee.h"
#include "runtime/checking/needle_path.h"
#include "runtime/devices/open_device.h"
#include "runtime/session/session_options.h"

namespace trocar::runtime {

inline constexpr const char* kProgram = "trocar-run";
inline constexpr double kDefaultRate_Hz = 1000;
/// Default of --late-ticks-in-row for a device with motors: if this number of deadlines is missed
/// in a row, a fault is raised.
inline constexpr int kDefaultLateTicks = 3;

/// The values of the options. run_options.cpp has the help text of each option. An empty string
/// means that the option was not given.
struct RunArguments {
  std::string scene, asset, force_law, new_scene, output;
  std::string entry, target;
  std::string procedure, strength;  ///< names that procedures.h defines
  bool explain = false;
  bool check = false, strict = false, live_hand = false, xray = false;
  std::string device{kDefaultDevice}, key_file, description, compensate = "none";
  bool simulated = false, test_device = false;
  std::string clock = "real", replay, live;
  std::optional<double> rate_Hz, duration_s;
  bool quiet = false;
  std::string record, summary, session_report, meshes, frames, hand_path;
  Trainee trainee;
  std::string history;
  std::string black_box, recover = "never", passivity = "on";
  std::optional<double> energy_limit_J, coupling_N_per_m, stiffness_limit_N_per_m;
  std::optional<double> force_limit_N, force_scale;
  /// If this number of deadlines is missed in a row, a fault is raised; 0: no fault is raised.
  /// None: kDefaultLateTicks for a device with motors, 0 for a simulated device.
  std::optional<int> late_ticks_in_row;
  int cpu = -1;  ///< the processor on which the haptic thread runs; -1: any

  /// True for a session or a replay, false for the commands that run neither.
  bool runs_session() const {
    return !check && !test_device && !explain && new_scene.empty() && history.empty();
  }
};

/// Checks what is not checked already while the command line is parsed. (The parser checks the
/// ranges and words that declare_run_options() has declared.) Errors: kUsage if a value is wrong,
/// if two options exclude each other, or if an option needs another one that was not given.
Result<void> check_run_arguments(const RunArguments& arguments);

/// Returns the points of --entry and --target. If --entry was not given, returns none. Errors:
/// kUsage if a point is not three numbers in mm.
Result<std::optional<ChosenPoints>> chosen_points(const RunArguments& arguments);

/// Sets the members of `options` that concern the haptic loop, its safety limits and black boxes.
void set_loop_options(const RunArguments& arguments, SessionOptions& options);

}  // namespace trocar::runtime
