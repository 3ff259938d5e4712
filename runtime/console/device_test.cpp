// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/device_test.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <sstream>
#include <system_error>

#include "formats/base/files.h"
#include "formats/base/json.h"
#include "formats/base/text.h"
#include "runtime/console/session_files.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;

constexpr const char *kMakingLog = "new-scene.txt", *kCheckLog = "check.txt";

std::string point_text(const std::array<double, 3>& mm) {
  return text_line("%.3f,%.3f,%.3f", mm[0], mm[1], mm[2]);
}

/// A scene that is not finished has a name that no list shows.
std::filesystem::path unfinished(const std::filesystem::path& scene) {
  return scene.string() + ".making";
}

std::string exists_already(const std::string& name) {
  return "there is a file " + name + ".json already; choose another name";
}

/// Takes the warnings of the check out of what it printed.
json warnings_in(std::string& text) {
  json warnings = json::array();
  std::string rest;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
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

/// The options that have a value. The option `simulated` has none.
constexpr std::string_view kWithValue[] = {"key-file", "device-description", "force-limit",
                                           "force-scale"};

/// Returns the text before the next comma, and removes both from `rest`.
std::string_view take_part(std::string_view& rest) {
  const std::size_t comma = rest.find(',');
  const std::string_view part = rest.substr(0, comma);
  rest.remove_prefix(comma == std::string_view::npos ? rest.size() : comma + 1);
  return part;
}

constexpr const char *kTestLog = "log.txt", *kTestResult = "test.json";

/// Returns the result that trocar-run has written; null if it has written none.
json result_in(const std::filesystem::path& file) {
  constexpr std::uint64_t kMaxResultBytes = std::uint64_t{64} << 10;
  const auto bytes = read_file(file, kMaxResultBytes);
  if (!bytes) return nullptr;
  json result = parse_json(*bytes);
  return result.is_object() ? result : json(nullptr);
}

}  // namespace

Result<void> SceneMaker::start(const NewSceneRequest& request, const Folders& folders,
                               const std::vector<std::string>& options) {
  const std::filesystem::path scene = folders.scenes / (request.name + ".json");
  std::error_code error;
  if (std::filesystem::symlink_status(scene, error).type() != std::filesystem::file_type::not_found)
    return refused(exists_already(request.name));
  auto logs = create_session_folder(folders.sessions, "new-scene");
  if (!logs) return logs.error();
  program_ = folders.programs / "trocar-run";
  // The device in the process and the one that the console starts are simulated alike.
  options_ = {"--device", request.device.name == kSimulator ? kInProcess : request.device.name};
  options_.insert(options_.end(), request.device.words.begin(), request.device.words.end());
  options_.insert(options_.end(), options.begin(), options.end());
  std::vector<std::string> words =
      words_of({program_, "new-scene", request.asset, "-o", unfinished(scene)});
  if (request.entry_mm) words.insert(words.end(), {"--entry", point_text(*request.entry_mm)});
  if (request.target_mm) words.insert(words.end(), {"--target", point_text(*request.target_mm)});
  if (request.has_live_hand) words.emplace_back("--live-hand");
  if (auto started = run_.start(words, *logs / kMakingLog); !started) return started;
  scene_ = scene;
  logs_ = std::move(*logs);
  name_ = request.name;
  state_ = State::kMaking;
  is_written_ = was_checked_ = was_stopped_ = false;
  end_.clear();
  error_.clear();
  return {};
}

std::vector<std::string> SceneMaker::words_of(std::vector<std::string> first) const {
  first.insert(first.end(), options_.begin(), options_.end());
  return first;
}

/// Gives the scene its name, unless there is a file of that name by now.
void SceneMaker::publish() {
  std::error_code error;
  std::filesystem::create_hard_link(unfinished(scene_), scene_, error);
  if (error && error != std::errc::file_exists) {  // a file system without hard links
    error.clear();
    if (std::filesystem::exists(std::filesystem::symlink_status(scene_, error)))
      error = std::make_error_code(std::errc::file_exists);
    else
      std::filesystem::rename(unfinished(scene_), scene_, error);
  }
  is_written_ = !error;
  if (error) error_ = error == std::errc::file_exists ? exists_already(name_) : error.message();
  std::filesystem::remove(unfinished(scene_), error);
}

void SceneMaker::poll(Clock::time_point now) {
  if (!is_running()) return;
  run_.poll(now);
  if (run_.is_running()) return;
  const bool is_good = run_.exit_code() == 0;
  end_ = run_.end();
  was_stopped_ = was_stopped_ || run_.was_stopped();
  if (state_ == State::kChecking) was_checked_ = is_good;
  const bool made = state_ == State::kMaking && is_good;
  state_ = State::kEnded;
  if (!made) return;
  publish();
  if (!is_written_ || was_stopped_) return;
  if (const auto started = run_.start(words_of({program_, "check", scene_}), logs_ / kCheckLog);
      started)
    state_ = State::kChecking;
  else
    error_ = started.error().message;
}

std::function<std::string()> SceneMaker::answer(const HiddenTexts& hidden) const {
  const char* const states[] = {"none", "making", "checking", "ended"};
  json out = {{"state", states[static_cast<int>(state_)]}};
  if (state_ != State::kNone) out["name"] = name_;
  if (is_written_) out["scene"] = scene_.filename().string();
  if (was_stopped_) out["stopped"] = true;
  if (state_ == State::kEnded && !end_.empty()) out["end"] = end_;
  if (!error_.empty()) out["error"] = hidden.hide(error_);
  return [out = std::move(out), logs = logs_, was_checked = was_checked_, hidden]() mutable {
    if (logs.empty()) return json_text(out);
    out["text"] = hidden.hide(tail_of(logs / kMakingLog));
    std::string check = hidden.hide(tail_of(logs / kCheckLog));
    if (was_checked) out["warnings"] = warnings_in(check);
    if (!check.empty()) out["check"] = std::move(check);
    return json_text(out);
  };
}

bool DeviceChoice::has(std::string_view word) const {
  return std::find(words.begin(), words.end(), word) != words.end();
}

Result<DeviceChoice> parse_device_choice(std::string_view text) {
  const std::string shown = "--device " + std::string(text);
  std::string_view rest = text;
  DeviceChoice choice{std::string(take_part(rest)), {}};
  while (!rest.empty() || text.ends_with(',')) {
    const std::string_view part = take_part(rest), name = part.substr(0, part.find('='));
    const bool has_value =
        std::find(std::begin(kWithValue), std::end(kWithValue), name) != std::end(kWithValue);
    const std::string_view value = part.substr(std::min(part.size(), name.size() + 1));
    if (has_value ? value.empty() : part != "simulated")
      return usage(shown +
                   ": after the device may follow ,key-file=FILE ,device-description=FILE "
                   ",force-limit=N ,force-scale=F or ,simulated");
    std::string word = "--" + std::string(name);
    if (choice.has(word)) return usage(shown + ": " + std::string(name) + " is given twice");
    choice.words.push_back(std::move(word));
    if (has_value) choice.words.emplace_back(value);
  }
  return choice;
}

void HiddenTexts::add(const std::string& text, const std::string& shown) {
  if (text.empty()) return;
  const auto at = std::find_if(entries_.begin(), entries_.end(),
                               [&](const Entry& entry) { return entry.text.size() < text.size(); });
  entries_.insert(at, {text, shown});
}

void HiddenTexts::add(const DeviceChoice& device) {
  for (std::size_t i = 1; i < device.words.size(); ++i) {
    if (device.words[i].find('/') != std::string::npos)
      add(device.words[i], "the file of " + device.words[i - 1].substr(2));
  }
}

std::string HiddenTexts::hide(std::string text) const {
  for (const auto& [hidden, shown] : entries_) {
    for (std::size_t at = text.find(hidden); at != std::string::npos;
         at = text.find(hidden, at + shown.size()))
      text.replace(at, hidden.size(), shown);
  }
  return text;
}

Result<void> DeviceTest::start(const DeviceChoice& device, const std::filesystem::path& programs,
                               const std::filesystem::path& sessions) {
  auto folder = create_session_folder(sessions, "device-test");
  if (!folder) return folder.error();
  std::vector<std::string> words = {
      programs / "trocar-run", "test", "--device", device.name, "--summary", *folder / kTestResult};
  words.insert(words.end(), device.words.begin(), device.words.end());
  if (auto started = run_.start(words, *folder / kTestLog); !started) return started;
  folder_ = std::move(*folder);
  device_ = device.name;
  return {};
}

std::function<std::string()> DeviceTest::answer(const HiddenTexts& hidden) const {
  json out = {{"state", is_running() ? "running" : run_.was_started() ? "ended" : "none"}};
  if (run_.was_started()) out["device"] = device_;
  if (run_.was_stopped()) out["stopped"] = true;
  if (const auto code = run_.exit_code()) out["exit_code"] = *code;
  return [out = std::move(out), folder = folder_, hidden]() mutable {
    if (folder.empty()) return json_text(out);
    out["text"] = hidden.hide(tail_of(folder / kTestLog));
    if (json result = result_in(folder / kTestResult); !result.is_null())
      out["result"] = std::move(result);
    return json_text(out);
  };
}

}  // namespace trocar::runtime
