// SPDX-License-Identifier: Apache-2.0
// Makes a scene for points that a person has chosen on the bone: trocar-run --new-scene and then --check, as processes of
// the console.
// Tests: tests/e2e/console_new_scene_test.py
#pragma once

#include <array>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "formats/base/result.h"
#include "runtime/console/programs/brief_run.h"
#include "runtime/console/programs/device_choice.h"

namespace trocar::runtime {

struct NewSceneRequest {
  std::filesystem::path asset;
  std::string name;  ///< of the scene's file, without ".json": as trainee_code_error() allows
  /// In the patient's frame (LPS, mm). Without an entry the needle enters where the bone is thickest.
  std::optional<std::array<double, 3>> entry_mm, target_mm;
  bool has_live_hand = false;
  DeviceChoice device;
};

class SceneMaker {
 public:
  using Clock = BriefRun::Clock;

  /// Starts to make a scene in `folder`. Nothing may be made yet. The programs' output goes into a new folder in `sessions`.
  /// Errors: (refused) there is a file of that name; (refused, unwritable) a folder or a process cannot be made.
  Result<void> start(const NewSceneRequest& request, const std::filesystem::path& programs,
                     const std::filesystem::path& folder, const std::filesystem::path& sessions);
  bool is_running() const noexcept {
    return state_ == State::kMaking || state_ == State::kChecking;
  }
  /// Asks the program that runs to end. A scene that is already written stays.
  void stop(Clock::time_point now) { run_.stop(now); }
  /// Notices the end of a program, and starts the check. The caller must call this every few milliseconds.
  void poll(Clock::time_point now);
  /// Returns a function that makes the answer to GET /api/new_scene (protocol.md). It reads files.
  std::function<std::string()> answer(const HiddenTexts& hidden) const;

 private:
  enum class State { kNone, kMaking, kChecking, kEnded };

  BriefRun run_;
  State state_ = State::kNone;
  std::filesystem::path program_, scene_, logs_;
  DeviceChoice device_;
  bool is_written_ = false, was_stopped_ = false;
  std::optional<int> exit_code_;
  std::string message_;  ///< why the check could not start
};

}  // namespace trocar::runtime
