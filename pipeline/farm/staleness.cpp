// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/farm/staleness.h"

#include <iterator>
#include <map>
#include <set>
#include <utility>

#include "formats/base/json_text.h"
#include "pipeline/farm/sha256.h"

namespace trocar::farm {
namespace {

using nlohmann::json;

void compare_parameters(const json& old, const json& now, std::vector<json>& out) {
  std::set<std::string> names;
  for (const json* one : {&old, &now})
    for (const auto& [name, value] : one->items())
      names.insert(name);
  for (const std::string& name : names) {
    const json before = old.value(name, json()), after = now.value(name, json());
    if (before != after)
      out.push_back({{"cause", "parameter"}, {"name", name}, {"old", before}, {"new", after}});
  }
}

json input_cause(const std::string& path, const char* what) {
  return {{"cause", "input"}, {"path", path}, {"what", what}};
}

// A file has changed if its bytes differ. Otherwise only its time has changed.
void compare_file(const ScanFile& old, const ScanFile& now, const Comparison& how,
                  std::vector<json>& out) {
  if (same_state(old, now) && !how.rehash) return;
  if (old.size != now.size) return out.push_back(input_cause(now.path, "changed"));
  if (!how.compare_bytes && !how.rehash) return out.push_back(input_cause(now.path, "time"));
  if (old.sha256.empty()) return;
  const auto digest = sha256_of_file(now.path);
  if (!digest || *digest != old.sha256) out.push_back(input_cause(now.path, "changed"));
}

void compare_files(const std::vector<ScanFile>& old, const std::vector<ScanFile>& now,
                   const Comparison& how, std::vector<json>& out) {
  if (!how.rehash && same_state(old, now)) return;
  std::map<std::string, const ScanFile*> before;
  for (const ScanFile& file : old)
    before.emplace(file.of + ":" + file.path, &file);
  for (const ScanFile& file : now) {
    const auto at = before.find(file.of + ":" + file.path);
    if (at == before.end()) {
      out.push_back(input_cause(file.path, "added"));
      continue;
    }
    compare_file(*at->second, file, how, out);
    before.erase(at);
  }
  for (const auto& [name, file] : before)
    out.push_back(input_cause(file->path, "removed"));
  if (old.size() == now.size() && before.empty()) {
    for (std::size_t k = 0; k < now.size(); ++k) {
      if (old[k].of == now[k].of && old[k].path == now[k].path) continue;
      out.push_back(input_cause(now[k].path, "order"));
      break;
    }
  }
}

void compare_input(const WantedScan& wanted, const ScanEntry& entry, const Comparison& how,
                   std::vector<json>& out) {
  if (entry.series != wanted.scan->series)
    out.push_back({{"cause", "input"},
                   {"what", "series"},
                   {"old", entry.series},
                   {"new", wanted.scan->series}});
  // An input that still cannot be listed, for the reason of the recorded failure, is unchanged.
  const auto add_error = [&](const Error& error) {
    if (entry.is_done() || entry.reason != error.message)
      out.push_back({{"cause", "input"}, {"what", error.message}});
  };
  const auto inputs = inputs_of(*wanted.scan);
  if (!inputs) return add_error(inputs.error());
  const auto now = list_files(all_paths(*inputs, *wanted.parameters));
  if (!now) return add_error(now.error());
  compare_files(entry.files, *now, how, out);
}

// The differences from the run that wrote the entry.
std::vector<json> changes_of(const WantedScan& wanted, const ScanProgram& program,
                             const Store& store, const ScanEntry& entry, const Comparison& how) {
  std::vector<json> out;
  if (entry.program != program.digest())
    out.push_back({{"cause", "program"}, {"old", entry.program}, {"new", program.digest()}});
  if (wanted.parameters == nullptr) {
    const auto refused = program.parameters(wanted.scan->parameters);
    if (refused || entry.is_done() || entry.reason != refused.error().message)
      out.push_back({{"cause", "input"}, {"what", "a file that a parameter names cannot be read"}});
    return out;
  }
  compare_parameters(entry.parameters, wanted.parameters->canonical, out);
  compare_input(wanted, entry, how, out);
  if (entry.is_done() && !store.has(*entry.outputs))
    out.push_back({{"cause", "store"}, {"what", "asset or report is missing or damaged"}});
  if (!store.links_fit(entry)) out.push_back({{"cause", "store"}, {"what", "link"}});
  return out;
}

}  // namespace

Result<ScanState> state_of(const WantedScan& wanted, const ScanProgram& program, const Store& store,
                           const Comparison& how) {
  const auto read = store.read_entry(wanted.scan->name);
  if (!read && read.error().is_temporary) return read.error();
  if (!read || !*read) return ScanState{ScanState::Kind::kStale, {{{"cause", "new"}}}};
  const auto& entry = *read;
  std::vector<json> changes = changes_of(wanted, program, store, *entry, how);
  ScanState out;
  if (entry->is_done()) {
    out.asset_bytes = entry->outputs->asset.bytes;
    out.warnings = entry->warnings;
    if (changes.empty()) out.kind = ScanState::Kind::kDone;
  } else {
    out.why = {{{"cause", "failed"}, {"reason", entry->reason}, {"exit_code", entry->exit_code}}};
    if (entry->signal != 0) out.why[0]["signal"] = entry->signal;
    if (changes.empty() && entry->is_lasting && !how.retry)
      out.kind = ScanState::Kind::kKnownFailure;
  }
  out.why.insert(out.why.end(), std::make_move_iterator(changes.begin()),
                 std::make_move_iterator(changes.end()));
  return out;
}

std::string cause_text(const json& cause) {
  std::string kind = cause["cause"];
  const auto text = [&cause](const char* key) {
    const json& value = cause[key];
    return value.is_string() ? value.get<std::string>() : json_text(value);
  };
  if (kind == "failed") return "it failed: " + text("reason");
  if (kind == "program")
    return "program: " + text("old").substr(0, 12) + " -> " + text("new").substr(0, 12);
  if (kind == "parameter")
    return "parameter " + text("name") + ": " + text("old") + " -> " + text("new");
  if (kind == "store") return "store: " + text("what");
  if (kind != "input") return kind;
  const std::string what = text("what");
  if (what == "series") return "input: series " + text("old") + " -> " + text("new");
  if (!cause.contains("path")) return "input: " + what;
  return "input " + text("path") + ": " +
         (what == "time"    ? "its time, path or inode changed; a run compares its bytes"
          : what == "order" ? "the order of files changed"
                            : what);
}

}  // namespace trocar::farm
