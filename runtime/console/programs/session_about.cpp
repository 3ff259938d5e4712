// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/programs/session_about.h"

#include <nlohmann/json.hpp>

#include "formats/base/file_io.h"
#include "formats/base/json_text.h"

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

}  // namespace trocar::runtime
