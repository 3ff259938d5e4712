// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/session_files.h"

#include <sys/stat.h>
#include <algorithm>
#include <cerrno>
#include <charconv>
#include <ctime>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <system_error>

#include "formats/base/files.h"
#include "formats/base/json.h"
#include "formats/base/text.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;

json object_of(std::string_view text) {
  json value = parse_json(text);
  return value.is_object() ? value : json::object();
}

std::string text_of(const json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? found->get<std::string>() : "";
}

std::int64_t whole_of(const json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_number_integer() ? found->get<std::int64_t>() : 0;
}

json read_note(const std::filesystem::path& file) {
  constexpr std::uint64_t kMaxNoteBytes = std::uint64_t{64} << 10;
  const auto bytes = read_file(file, kMaxNoteBytes);
  if (!bytes) return json::object();
  return object_of({reinterpret_cast<const char*>(bytes->data()), bytes->size()});
}

std::string folder_name(const std::filesystem::path& scene) {
  std::string name = scene.stem().string().substr(0, 64);
  std::replace_if(
      name.begin(), name.end(),
      [](char c) {
        return !((c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                 c == '_' || c == '-');
      },
      '_');
  return utc_name(std::time(nullptr)) + "-" + name;
}

}  // namespace

SessionAbout parse_about(std::string_view text, std::size_t snapshot_values) {
  const json about = object_of(text);
  SessionAbout out;
  out.json = json_text(about);
  out.id = std::to_string(whole_of(about, "pid")) + "-" + text_of(about, "started_at");
  if (about.contains("scene") && about["scene"].is_object())
    out.scene = text_of(about["scene"], "file");
  out.asset = text_of(about, "asset");
  out.record = text_of(about, "record");
  out.clock = text_of(about, "clock");
  out.device = text_of(about, "device");
  out.has_live_hand = about.contains("hand") && about["hand"].is_object();
  out.takes_xray = about.value("xray", json()) == json(true);
  std::size_t at = 0;
  json columns = json::array();
  if (about.contains("columns") && about["columns"].is_array()) {
    for (const json& column : about["columns"]) {
      const std::int64_t count = column.is_object() ? whole_of(column, "count") : 0;
      if (count < 1 || at + static_cast<std::size_t>(count) > snapshot_values) break;
      out.column_at.emplace_back(text_of(column, "name"), at);
      at += static_cast<std::size_t>(count);
      columns.push_back(column);
    }
  }
  out.columns = json_text(columns);
  if (about.contains("sheets") && about["sheets"].is_array()) {
    for (const json& sheet : about["sheets"])
      out.slices.push_back(sheet.is_object() ? static_cast<std::int32_t>(whole_of(sheet, "slice"))
                                             : -1);
  }
  return out;
}

Result<void> write_device_note(const std::filesystem::path& file, const std::string& device,
                               const std::optional<DeviceNote>& process) {
  json note = {{"schema", "trocar.console-session/1"}, {"device", device}};
  if (process) {
    note["device_pid"] = process->pid;
    note["device_start_ticks"] = process->start_ticks;
    note["device_endpoint"] = process->endpoint;
  }
  return write_file_atomically(file, json_text(note, 2) + "\n", Readers::kOwner);
}

std::string noted_device(const std::filesystem::path& file) {
  constexpr std::size_t kMaxNameBytes = 200;
  return text_of(read_note(file), "device").substr(0, kMaxNameBytes);
}

std::optional<DeviceNote> read_device_note(const std::filesystem::path& file) {
  const json note = read_note(file);
  if (!note.contains("device_pid")) return std::nullopt;
  return DeviceNote{whole_of(note, "device_pid"),
                    static_cast<std::uint64_t>(whole_of(note, "device_start_ticks")),
                    text_of(note, "device_endpoint")};
}

Result<std::filesystem::path> create_session_folder(const std::filesystem::path& sessions,
                                                    const std::filesystem::path& scene) {
  std::error_code error;
  if (std::filesystem::is_symlink(sessions, error))
    return refused(sessions.string() + ": is a link");
  const std::string name = folder_name(scene);
  if (std::filesystem::create_directories(sessions, error))
    std::filesystem::permissions(sessions, std::filesystem::perms::owner_all, error);
  constexpr int kMaxOfASecond = 100;
  std::filesystem::path folder;
  for (int i = 1; i < kMaxOfASecond && !error; ++i) {
    folder = sessions / (i == 1 ? name : name + "-" + std::to_string(i));
    if (::mkdir(folder.c_str(), 0700) == 0) return folder;
    if (errno != EEXIST) error = std::error_code(errno, std::generic_category());
  }
  return unwritable(folder.string() + ": cannot be made: " +
                    (error ? error.message() : "all folders of this name and second exist"));
}

std::string ready_endpoint(const std::filesystem::path& log, std::uint64_t from) {
  constexpr std::string_view kReady = "ready on ";
  std::ifstream in(log, std::ios::binary);
  in.seekg(static_cast<std::streamoff>(from));
  std::string text(4096, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(in.gcount()));
  const std::size_t at = text.find(kReady), end = text.find('\n', at);
  return at == std::string::npos || end == std::string::npos
             ? ""
             : text.substr(at + kReady.size(), end - at - kReady.size());
}

std::string tail_of(const std::filesystem::path& log) {
  constexpr std::streamoff kMaxTailBytes = 64 << 10;
  std::ifstream in(log, std::ios::binary | std::ios::ate);
  std::string text;
  if (!in) return text;
  const std::streamoff size = in.tellg();
  in.seekg(std::max<std::streamoff>(0, size - kMaxTailBytes));
  text.resize(static_cast<std::size_t>(std::min(size, kMaxTailBytes)));
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(in.gcount()));
  return text;
}

std::string last_line(const std::filesystem::path& log) {
  constexpr std::size_t kMaxLineBytes = 400;
  std::istringstream in(tail_of(log));
  std::string line, last;
  while (std::getline(in, line)) {
    if (!line.empty()) last = line;
  }
  return last.substr(0, kMaxLineBytes);
}

std::string reason_of(ExitCode code, const std::filesystem::path& folder) {
  constexpr std::uintmax_t kFull_bytes = 64 << 10;
  std::error_code error;
  const std::filesystem::space_info space = std::filesystem::space(folder, error);
  switch (code) {
    case ExitCode::kUnwritable:
      return !error && space.available < kFull_bytes
                 ? "the disk of the folder of sessions is full; free some space, and start again"
                 : "a file of the session could not be written";
    case ExitCode::kUsage:
      return "its options are wrong";
    case ExitCode::kRefused:
      return "an input was refused";
    case ExitCode::kDeviceFault:
      return "the device or the safety layer ended it";
    case ExitCode::kDone:
    case ExitCode::kBug:
      break;
  }
  return "it gave no reason";
}

pid_t pid_of_link(const std::filesystem::path& link) {
  constexpr std::string_view kProc = "/proc/";
  std::error_code error;
  const std::string target = std::filesystem::read_symlink(link, error).string();
  pid_t pid = 0;
  if (!error && target.starts_with(kProc))
    std::from_chars(target.data() + kProc.size(), target.data() + target.size(), pid);
  return pid;
}

}  // namespace trocar::runtime
