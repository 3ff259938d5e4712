// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/programs/scene_maker.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "formats/base/json_text.h"
#include "formats/base/text_line.h"
#include "runtime/console/programs/session_files.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;

constexpr const char *kMakingLog = "new-scene.txt", *kCheckLog = "check.txt";

std::string point_text(const std::array<double, 3>& mm) {
  return text_line("%.3f,%.3f,%.3f", mm[0], mm[1], mm[2]);
}

/// Returns a name relative to the current folder, so that the scene names its asset relative to itself.
std::string relative_name(const std::filesystem::path& file) {
  std::error_code error;
  const std::filesystem::path relative = std::filesystem::relative(file, error);
  return error || relative.empty() ? file.string() : relative.string();
}

/// Takes the warnings of --check out of what it printed.
json warnings_in(std::string& text) {
  json warnings = json::array();
  std::string rest;
  for (std::size_t from = 0; from < text.size();) {
    const std::size_t end = std::min(text.find('\n', from), text.size());
    const std::string line = text.substr(from, end - from);
    from = end + 1;
    constexpr std::string_view kStart = "trocar-run: warning: ";
    if (!line.starts_with(kStart)) {
      rest += line + '\n';
      continue;
    }
    const std::size_t colon = line.find(": ", kStart.size());  // after the scene's name
    warnings.push_back(colon == std::string::npos ? line : line.substr(colon + 2));
  }
  text = std::move(rest);
  return warnings;
}

}  // namespace

Result<void> SceneMaker::start(const NewSceneRequest& request,
                               const std::filesystem::path& programs,
                               const std::filesystem::path& folder,
                               const std::filesystem::path& sessions) {
  const std::filesystem::path scene = folder / (request.name + ".json");
  std::error_code error;
  if (std::filesystem::exists(std::filesystem::symlink_status(scene, error)))
    return refused("there is a file " + request.name + ".json already; choose another name");
  auto logs = create_session_folder(sessions, "new-scene");
  if (!logs) return logs.error();
  DeviceChoice device = request.device;
  if (device.name == kSimulator) device.name = kInProcess;  // both simulate the same device
  std::vector<std::string> words = {programs / "trocar-run",
                                    "--new-scene",
                                    relative_name(request.asset),
                                    "-o",
                                    relative_name(scene),
                                    "--device",
                                    device.name};
  words.insert(words.end(), device.words.begin(), device.words.end());
  if (request.entry_mm) words.insert(words.end(), {"--entry", point_text(*request.entry_mm)});
  if (request.target_mm) words.insert(words.end(), {"--target", point_text(*request.target_mm)});
  if (request.has_live_hand) words.emplace_back("--live-hand");
  if (auto started = run_.start(words, *logs / kMakingLog); !started) return started;
  program_ = words.front();
  scene_ = scene;
  logs_ = std::move(*logs);
  device_ = std::move(device);
  state_ = State::kMaking;
  is_written_ = was_stopped_ = false;
  exit_code_.reset();
  message_.clear();
  return {};
}

void SceneMaker::poll(Clock::time_point now) {
  if (!is_running()) return;
  run_.poll(now);
  if (run_.is_running()) return;
  exit_code_ = run_.exit_code();
  was_stopped_ = was_stopped_ || run_.was_stopped();
  const bool made = state_ == State::kMaking && exit_code_ == 0;
  state_ = State::kEnded;
  if (!made) return;
  is_written_ = true;
  if (was_stopped_) return;
  std::vector<std::string> words = {program_, scene_, "--check", "--device", device_.name};
  words.insert(words.end(), device_.words.begin(), device_.words.end());
  if (const auto started = run_.start(words, logs_ / kCheckLog); started)
    state_ = State::kChecking;
  else
    message_ = started.error().message;
}

std::function<std::string()> SceneMaker::answer(const HiddenTexts& hidden) const {
  const char* const states[] = {"none", "making", "checking", "ended"};
  json out = {{"state", states[static_cast<int>(state_)]}};
  if (is_written_) out["scene"] = scene_.filename().string();
  if (was_stopped_) out["stopped"] = true;
  if (state_ == State::kEnded && exit_code_) out["exit_code"] = *exit_code_;
  if (!message_.empty()) out["error"] = message_;
  return [out = std::move(out), logs = logs_, hidden]() mutable {
    if (logs.empty()) return json_text(out);
    out["text"] = hidden.hide(tail_of(logs / kMakingLog));
    std::string check = hidden.hide(tail_of(logs / kCheckLog));
    if (check.empty()) return json_text(out);
    out["warnings"] = warnings_in(check);
    out["check"] = std::move(check);
    return json_text(out);
  };
}

}  // namespace trocar::runtime
