// SPDX-License-Identifier: Apache-2.0
// Makes a scene. A person may choose on the bone where the needle enters and where it goes. The
// console first runs trocar-run new-scene, and then trocar-run check.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "runtime/console/device_test.h"
#include "runtime/console/process.h"

namespace trocar::runtime {

struct NewSceneRequest {
  std::filesystem::path asset;
  std::string name;  ///< name of the scene's file without ".json": 1 to 32 letters, digits, - or _
  /// The points that were chosen for the needle, in the patient's frame (LPS, mm). Without an entry
  /// the needle goes through the thickest bone. If there is a target, there must be an entry.
  std::optional<std::array<double, 3>> entry_mm, target_mm;
  bool has_live_hand = false;
  DeviceChoice device;
};

class SceneMaker {
 public:
  using Clock = BriefRun::Clock;
  struct Folders {
    std::filesystem::path programs;  ///< the folder that contains trocar-run
    std::filesystem::path scenes;    ///< the folder that gets the new scene
    std::filesystem::path sessions;  ///< gets a new folder with the programs' output
  };

  /// Starts to make a scene. Precondition: is_running() is false. `options`: options of trocar-run
  /// that the console gives to every session. Errors: kRefused if a file with the scene's name
  /// exists; those of create_session_folder() and BriefRun::start().
  Result<void> start(const NewSceneRequest& request, const Folders& folders,
                     const std::vector<std::string>& options);
  bool is_running() const noexcept {
    return state_ == State::kMaking || state_ == State::kChecking;
  }
  /// Asks the running program to end. If the scene is already written, it stays.
  void stop(Clock::time_point now) { run_.stop(now); }
  /// Checks whether the running program has ended. When new-scene has succeeded, renames the new
  /// file from its temporary name to the scene's name, and starts check. The caller must call
  /// this every few milliseconds.
  void poll(Clock::time_point now);
  /// Returns a function that makes the answer to GET /api/new_scene (protocol.md). The function
  /// reads files, so call it on the worker thread.
  std::function<std::string()> answer(const HiddenTexts& hidden) const;

 private:
  enum class State : std::uint8_t { kNone, kMaking, kChecking, kEnded };

  std::vector<std::string> words_of(std::vector<std::string> first) const;
  void publish();

  BriefRun run_;
  State state_ = State::kNone;
  std::filesystem::path program_, scene_, logs_;
  std::string name_;
  /// Options for both runs: the options of the device, and the options of every session.
  std::vector<std::string> options_;
  bool is_written_ = false, was_checked_ = false, was_stopped_ = false;
  std::string end_;    ///< how the last program has ended
  std::string error_;  ///< the reason why the scene was not kept, or why the check could not start
};

}  // namespace trocar::runtime
