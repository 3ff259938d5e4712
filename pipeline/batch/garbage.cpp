// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/batch/garbage.h"

#include <algorithm>
#include <iterator>
#include <map>

#include "pipeline/batch/lease.h"

namespace trocar::farm {
namespace {

namespace fs = std::filesystem;
using std::chrono::nanoseconds;

// The files KEY.ENDING in the sub-folders of a folder whose names are digests. Others are not the
// store's, and stay.
Result<std::vector<fs::path>> files_in(const fs::path& folder, const char* ending) {
  std::vector<fs::path> out;
  const auto fans = listed(folder);
  if (!fans) return fans.error();
  for (const fs::path& fan : *fans) {
    if (fan.filename().string().size() != 2) continue;
    auto files = listed(fan);
    if (!files) return files.error();
    std::copy_if(files->begin(), files->end(), std::back_inserter(out), [&](const fs::path& file) {
      return file.extension() == ending && is_sha256(file.stem().string());
    });
  }
  return out;
}

// What a store holds, and what of it must stay.
struct Inventory {
  std::vector<std::string> unwanted;  // entries to drop
  std::set<std::string> keys;         // of the other entries
  std::set<std::string> digests;      // of the contents that these entries name
  std::vector<fs::path> actions, contents;
  std::map<std::string, std::vector<Object>> outputs;  // of the actions, by key
};

Result<Inventory> take_inventory(const Store& store, const std::set<std::string>* wanted) {
  Inventory out;
  const auto names = store.names();
  if (!names) return names.error();
  for (const std::string& name : *names) {
    const auto entry = store.read_entry(name);
    if (!entry) return entry.error();
    if (!*entry) continue;  // another process has dropped it
    if (wanted != nullptr && !wanted->contains(name)) {
      out.unwanted.push_back(name);
      continue;
    }
    if (!(*entry)->key.empty()) out.keys.insert((*entry)->key);
    if (const auto& made = (*entry)->outputs)
      out.digests.insert({made->asset.sha256, made->report.sha256});
  }
  if (const auto ok = files_in(store.folder() / "actions", ".json").into(out.actions); !ok)
    return ok.error();
  for (const fs::path& action : out.actions) {
    const std::string key = action.stem().string();
    auto outputs = store.outputs_of(key);
    if (!outputs) return outputs.error();
    if (*outputs) out.outputs.emplace(key, std::move(**outputs));
  }
  if (const auto ok = files_in(store.folder() / "content", "").into(out.contents); !ok)
    return ok.error();
  return out;
}

// The times that count as old: longer ago than the grace, or so far in the future that the clock of
// the file server must have been set back. Times in the near future are those that other processes
// set while this one works.
class OldTimes {
 public:
  OldTimes(nanoseconds now, nanoseconds grace)
      : before_(now - grace), after_(now + std::max<nanoseconds>(grace, kLeaseDuration)) {}
  bool contain(const std::optional<nanoseconds>& time) const {
    return time && (*time < before_ || *time > after_);
  }

 private:
  nanoseconds before_, after_;
};

// Removes a file unless it is young or leased. The file is first moved away, so that no batch finds
// it any more. If a batch had renewed its time before it was moved, the file is moved back.
bool remove_old(const Store& store, const fs::path& file, const OldTimes& old,
                const std::function<bool()>& is_held, Collected& out) {
  if (!old.contain(time_of(file)) || is_held()) return false;
  const fs::path away = temporary_name(store.tmp());
  if (::rename(file.c_str(), away.c_str()) != 0) return false;
  failpoint("moved-away");
  struct stat status {};
  if (!old.contain(time_of(away)) || is_held() || ::stat(away.c_str(), &status) != 0 ||
      ::unlink(away.c_str()) != 0) {
    ::rename(away.c_str(), file.c_str());
    return false;
  }
  out.bytes += static_cast<std::uint64_t>(status.st_size);
  ++out.removed;
  return true;
}

}  // namespace

Result<Collected> collect_garbage(const Store& store, nanoseconds grace,
                                  const std::set<std::string>* wanted) {
  const auto now = store.now();
  if (!now) return now.error();
  const OldTimes old(*now, grace);
  auto found = take_inventory(store, wanted);
  if (!found) {
    Error error = found.error();
    error.message += "; so it is not known what the store needs, and nothing was removed";
    return error;
  }
  Collected out;
  for (const std::string& name : found->unwanted) {
    if (auto ok = store.drop_entry(name); !ok) return ok.error();
    ++out.dropped;
  }
  for (const fs::path& action : found->actions) {
    const std::string key = action.stem().string();
    const auto is_held = [&] { return is_leased(store, key); };
    if (!found->keys.contains(key) && remove_old(store, action, old, is_held, out)) continue;
    for (const Object& object : found->outputs[key])
      found->digests.insert(object.sha256);
    ++out.kept;
  }
  for (const fs::path& content : found->contents) {
    if (found->digests.contains(content.filename().string()) ||
        !remove_old(
            store, content, old, [] { return false; }, out))
      ++out.kept;
  }
  return out;
}

}  // namespace trocar::farm
