// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/farm/garbage.h"

#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include "formats/base/file_io.h"
#include "formats/base/json_text.h"
#include "pipeline/farm/atomic_file.h"
#include "pipeline/farm/failpoint.h"
#include "pipeline/farm/lease.h"
#include "pipeline/farm/sha256.h"

namespace trocar::farm {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using std::chrono::nanoseconds;

// The files in the sub-folders of a folder.
std::vector<fs::path> files_in(const fs::path& folder) {
  std::vector<fs::path> out;
  std::error_code ignored;
  for (const auto& fan : fs::directory_iterator(folder, ignored)) {
    for (const auto& file : fs::directory_iterator(fan.path(), ignored))
      out.push_back(file.path());
  }
  return out;
}

std::set<std::string> live_keys(const Store& store) {
  std::set<std::string> out;
  for (const std::string& name : store.names()) {
    const auto entry = store.entry(name);
    if (!entry) continue;
    if (!entry->key.empty()) out.insert(entry->key);
    for (const auto& [product, stored] : entry->products)
      if (!stored.key.empty()) out.insert(stored.key);
  }
  return out;
}

void keep_outputs(const fs::path& action, std::set<std::string>& digests) {
  const auto bytes = read_file(action);
  if (!bytes) return;
  const json value = parse_json(*bytes);
  if (!value.is_object() || !value.contains("outputs")) return;
  for (const char* of : {"asset", "report", "file"}) {
    const json output = value["outputs"].value(of, json::object());
    if (output.is_object() && output.contains("sha256") && output["sha256"].is_string())
      digests.insert(output["sha256"].get<std::string>());
  }
}

// Removes a file unless it is young or leased. The file is first moved away, so that no batch finds
// it any more. If a batch had renewed its time before it was moved, the file is moved back.
bool remove_old(const Store& store, const fs::path& file, nanoseconds before,
                const std::function<bool()>& is_held, Collected& out) {
  const auto seen = time_of(file);
  if (!seen || *seen >= before || is_held()) return false;
  const fs::path away = temporary_name(store.tmp());
  if (::rename(file.c_str(), away.c_str()) != 0) return false;
  failpoint("moved-away");
  const auto time = time_of(away);
  if (!time || *time >= before || is_held()) {
    ::rename(away.c_str(), file.c_str());
    return false;
  }
  struct stat status {};
  if (::stat(away.c_str(), &status) == 0) out.bytes += static_cast<std::uint64_t>(status.st_size);
  ::unlink(away.c_str());
  ++out.removed;
  return true;
}

}  // namespace

Result<Collected> collect_garbage(const Store& store, nanoseconds grace) {
  const auto now = store.now();
  if (!now) return now.error();
  const nanoseconds before = *now - grace;
  Collected out;
  const std::set<std::string> live = live_keys(store);
  std::set<std::string> digests;
  for (const fs::path& action : files_in(store.folder() / "actions")) {
    const std::string key = action.stem().string();
    const auto is_held = [&] { return is_sha256(key) && is_leased(store, key); };
    if (live.contains(key) || !remove_old(store, action, before, is_held, out)) {
      keep_outputs(action, digests);
      ++out.kept;
    }
  }
  for (const fs::path& content : files_in(store.folder() / "content")) {
    if (digests.contains(content.filename().string()) ||
        !remove_old(
            store, content, before, [] { return false; }, out))
      ++out.kept;
  }
  return out;
}

}  // namespace trocar::farm
