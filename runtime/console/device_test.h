// SPDX-License-Identifier: Apache-2.0
// What a page prepares before a session: a device and its test, and a new scene.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"
#include "runtime/console/process.h"

namespace trocar::runtime {

// The devices that a page may choose. The person who starts trocar-console lists devices by the
// option --device. A page chooses one of these devices by its name or its index in the list, or one
// of Trocar's two simulated devices by its name. It can never choose another URI, a file or option.

/// The names of the two devices that Trocar itself simulates. kInProcess: trocar-run simulates the
/// device. kSimulator: the console starts a separate process that simulates the device.
inline constexpr const char *kInProcess = "inproc", *kSimulator = "sim";

struct DeviceChoice {
  std::string name = kInProcess;   ///< kInProcess, kSimulator or a URI; pages show it
  std::vector<std::string> words;  ///< options for trocar-run, such as "--key-file", "FILE"

  bool has(std::string_view word) const;
  /// True if Trocar itself simulates the device, or if `words` contains --simulated.
  bool is_simulated() const { return !can_be_tested() || has("--simulated"); }
  /// True unless Trocar itself simulates the device (kInProcess, kSimulator).
  bool can_be_tested() const { return name != kInProcess && name != kSimulator; }
};

/// Reads a device and its options, written as
/// "URI[,key-file=FILE][,device-description=FILE][,force-limit=N][,force-scale=F][,simulated]".
/// The values are not checked here; trocar-run checks them. Errors: kUsage if an option is unknown,
/// repeated or without its value.
Result<DeviceChoice> parse_device_choice(std::string_view text);

/// Replaces texts that pages must not see, such as names of folders. Apply hide() to each text that
/// may contain them before the text is sent to pages.
class HiddenTexts {
 public:
  /// Makes hide() replace `text` by `shown`.
  void add(const std::string& text, const std::string& shown);
  /// Makes hide() replace each value of the device's options that contains a /, and so names a
  /// folder, by a text such as "the file of key-file".
  void add(const DeviceChoice& device);
  std::string hide(std::string text) const;

 private:
  struct Entry {
    std::string text, shown;
  };
  std::vector<Entry> entries_;  ///< longest text first, because a text may contain another
};

// Tests a device before a session: the console runs trocar-run test. In the test the
// device gets no force.

class DeviceTest {
 public:
  using Clock = BriefRun::Clock;

  /// Starts a test. `programs`: the folder that contains trocar-run. The files of the test go into
  /// a new folder in `sessions`. Precondition: is_running() is false. Errors: those of
  /// create_session_folder() and BriefRun::start().
  Result<void> start(const DeviceChoice& device, const std::filesystem::path& programs,
                     const std::filesystem::path& sessions);
  bool is_running() const noexcept { return run_.is_running(); }
  void stop(Clock::time_point now) { run_.stop(now); }
  /// Checks whether the test has ended. The caller must call this every few milliseconds.
  void poll(Clock::time_point now) { run_.poll(now); }
  /// Returns a function that makes the answer to GET /api/test (protocol.md). The function reads
  /// files, so call it on the worker thread.
  std::function<std::string()> answer(const HiddenTexts& hidden) const;

 private:
  BriefRun run_;
  std::filesystem::path folder_;
  std::string device_;
};

// Makes a scene. A person may choose on the bone where the needle enters and where it goes. The
// console first runs trocar-run new-scene, and then trocar-run check.

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
