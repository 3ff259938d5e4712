// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/device_test.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "formats/base/files.h"
#include "formats/base/json.h"
#include "runtime/console/session_files.h"

namespace trocar::runtime {
namespace {

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

using nlohmann::json;

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
