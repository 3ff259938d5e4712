// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/programs/device_test.h"

#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "formats/base/file_io.h"
#include "formats/base/json_text.h"
#include "runtime/console/programs/session_files.h"

namespace trocar::runtime {
namespace {

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

Result<void> DeviceTest::start(const DeviceChoice& device, const std::filesystem::path& programs,
                               const std::filesystem::path& sessions) {
  auto folder = create_session_folder(sessions, "device-test");
  if (!folder) return folder.error();
  std::vector<std::string> words = {
      programs / "trocar-run", "test", "--device", device.name, "--summary",
      *folder / kTestResult};
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
