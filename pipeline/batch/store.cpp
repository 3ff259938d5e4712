// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/batch/store.h"

#include <fcntl.h>
#include <algorithm>
#include <array>
#include <atomic>
#include <ctime>

#include "formats/base/json.h"
#include "formats/base/text.h"
#include "pipeline/batch/lease.h"

namespace trocar::farm {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using std::chrono::nanoseconds;

// Removes a temporary file that has not become the target.
class Temporary {
 public:
  explicit Temporary(fs::path path) : path_(std::move(path)) {}
  Temporary(const Temporary&) = delete;
  Temporary& operator=(const Temporary&) = delete;
  ~Temporary() {
    if (!renamed_) ::unlink(path_.c_str());
  }
  const char* name() const { return path_.c_str(); }
  const fs::path& path() const { return path_; }
  bool rename_to(const fs::path& target) {
    return renamed_ = ::rename(path_.c_str(), target.c_str()) == 0;
  }

 private:
  fs::path path_;
  bool renamed_ = false;
};

// The first call must precede all threads, because the mask can be read only by setting it.
mode_t process_mask() {
  static const mode_t mask = [] {
    const mode_t now = ::umask(077);
    ::umask(now);
    return now;
  }();
  return mask;
}

// Makes a folder like `like` (give_to_users()). If it exists, it is left as it is. Errors:
// kUnwritable.
// The new folder's own entry is not synced here: file systems with a journal write it together with
// the later sync of a file in the folder.
Result<void> make_folder(const fs::path& folder, const fs::path& like) {
  if (::mkdir(folder.c_str(), 0777) != 0) {
    if (errno == EEXIST) return {};
    return cannot_write(folder, errno);
  }
  const FileDescriptor fd(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (fd.get() < 0 || !give_to_users(fd.get(), like, 0777)) return cannot_write(folder, errno);
  return {};
}

// Syncs a folder's entries to the disk. Errors: kUnwritable; the message names the folder.
Result<void> sync_folder(const fs::path& folder) {
  const FileDescriptor fd(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (fd.get() < 0) return cannot_write(folder, errno);
  // Some file systems cannot sync folders.
  if (::fsync(fd.get()) != 0 && errno != EINVAL && errno != ENOTSUP)
    return cannot_write(folder, errno);
  return {};
}

// Makes `link` a symbolic link to `target` by a rename, which replaces an older link. The link is
// not synced. Errors: kUnwritable; the message names the link.
Result<void> link_atomically(const fs::path& target, const fs::path& link, const fs::path& tmp) {
  std::error_code error;
  if (fs::read_symlink(link, error) == target && !error) return {};
  Temporary temporary(temporary_name(tmp));
  if (::symlink(target.c_str(), temporary.name()) != 0) return cannot_write(link, errno);
  failpoint("link-made");
  if (!temporary.rename_to(link)) return cannot_write(link, errno);
  failpoint("link-renamed");
  return {};
}

constexpr const char* kMark = "trocar-store.json";
constexpr const char* kSchema = "trocar.store/1";
constexpr std::array<const char*, 8> kFolders = {"actions", "content", "scans",  "assets",
                                                 "reports", "journal", "claims", "tmp"};
constexpr std::uint64_t kMaxJsonBytes = std::uint64_t{1} << 28;
constexpr mode_t kPrivate = 0600;

json object_json(const Object& object) {
  return {{"sha256", object.sha256}, {"bytes", object.bytes}};
}

Object object_from(const json& value) {
  Object out{value.at("sha256").get<std::string>(), value.at("bytes").get<std::uint64_t>()};
  if (!is_sha256(out.sha256) || !value.at("bytes").is_number_unsigned())
    throw json::other_error::create(501, "no digest", &value);
  return out;
}

// The text of a JSON file of the store; std::nullopt if there is no such file. The callers check it,
// because a store is not trusted more than other files. Errors: kRefused if the file is there, but
// cannot be read.
Result<std::optional<std::string>> text_of(const fs::path& file) {
  auto bytes = read_file(file, kMaxJsonBytes);
  struct stat status {};
  if (!bytes && ::lstat(file.c_str(), &status) != 0 && errno == ENOENT)
    return std::optional<std::string>();
  if (!bytes) bytes = read_file(file, kMaxJsonBytes);  // it may have come since
  if (!bytes) return refused_for_now(bytes.error().message);
  return std::optional(std::string(bytes->begin(), bytes->end()));
}

Error damaged(const fs::path& file) {
  return refused(file.string() + ": is damaged, or of another version");
}

std::string fanned_out(const std::string& digest) {
  return digest.substr(0, 2) + "/" + digest;
}

fs::path link_target(const Object& object) {
  return fs::path("..") / "content" / fanned_out(object.sha256);
}

bool is_there(const fs::path& file, std::uint64_t bytes) {
  struct stat status {};
  return ::stat(file.c_str(), &status) == 0 && S_ISREG(status.st_mode) &&
         static_cast<std::uint64_t>(status.st_size) == bytes;
}

bool renew_time(const fs::path& file) {
  return ::utimensat(AT_FDCWD, file.c_str(), nullptr, 0) == 0;
}

Result<bool> has_mark(const fs::path& folder) {
  const auto text = text_of(folder / kMark);
  if (!text) return text.error();
  if (!*text) return false;
  const json mark = parse_json(**text);
  if (!mark.is_object() || !mark.contains("schema"))
    return usage(folder.string() + ": its " + kMark + " is damaged");
  if (mark["schema"] != kSchema)
    return usage(folder.string() + ": a store of another version, " + json_text(mark["schema"]) +
                 "; this program writes " + kSchema);
  return true;
}

// Refuses a folder with other files, so that it does not become a store.
Result<void> check_empty(const fs::path& folder) {
  const auto files = listed(folder);
  if (!files) return unwritable(files.error().message);
  for (const fs::path& one : *files) {
    const std::string name = one.filename().string();
    if (std::find(kFolders.begin(), kFolders.end(), name) == kFolders.end() && name != kMark)
      return usage(folder.string() + ": is no store, and holds " + name + "; give an empty folder");
  }
  return {};
}

// Refuses a process whose files the users of the store could not read or replace. A probe shows
// whose file it is for the file system, which may map users to others.
Result<void> check_user(const fs::path& folder, const fs::path& tmp) {
  struct stat users {
  }, own{};
  if (::stat(tmp.c_str(), &users) != 0) {
    if (errno == ENOENT) return {};  // a new store
    return cannot_write(tmp, errno);
  }
  const fs::path probe = temporary_name(tmp);
  const FileDescriptor fd(::open(probe.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
  const bool is_given =
      fd.get() >= 0 && give_to_users(fd.get(), tmp, 0600) && ::fstat(fd.get(), &own) == 0;
  const int error = is_given ? 0 : errno;
  if (fd.get() >= 0) ::unlink(probe.c_str());
  if (is_given && own.st_uid == users.st_uid) return {};
  if (is_given && is_shared(users) && own.st_gid == users.st_gid) return {};
  const bool is_of_rights = error == EACCES || error == EPERM;
  if (error != 0 && (!is_of_rights || ::geteuid() == users.st_uid)) return cannot_write(tmp, error);
  return unwritable(folder.string() + ": belongs to user " + std::to_string(users.st_uid) +
                    (is_shared(users) ? " and group " + std::to_string(users.st_gid)
                                      : " alone; to share a store, make its folder with the "
                                        "group's rights and the bit setgid (chmod 2775)"));
}

// The outputs that an action's file states; null if there is no such file. Errors: those of
// outputs_of(), but the shape of the outputs is not checked.
Result<json> outputs_in(const fs::path& file, const std::string& key) {
  const auto text = text_of(file);
  if (!text) return text.error();
  if (!*text) return json();
  const json value = parse_json(**text);
  try {
    if (sha256_of(json_text(value.at("action"))) == key) return json(value.at("outputs"));
  } catch (const json::exception&) {
  }
  return damaged(file);
}

fs::path asset_link(const fs::path& store, const std::string& name) {
  return store / "assets" / (name + ".glb");
}
fs::path report_link(const fs::path& store, const std::string& name) {
  return store / "reports" / (name + ".json");
}

bool leads_to(const fs::path& link, const fs::path& target) {
  std::error_code error;
  return fs::read_symlink(link, error) == target && !error;
}

bool is_absent(const fs::path& link) {
  struct stat status {};
  return ::lstat(link.c_str(), &status) != 0 && errno == ENOENT;
}

std::string time_text() {
  using namespace std::chrono;
  const auto now = system_clock::now();
  const auto ms = duration_cast<milliseconds>(now.time_since_epoch()).count() % 1000;
  std::string out = utc_text(system_clock::to_time_t(now));
  out.pop_back();  // the Z
  return out + text_line(".%03dZ", static_cast<int>(ms));
}

}  // namespace

bool is_shared(const struct stat& folder) {
  constexpr mode_t kBits = S_ISGID | S_IWGRP;
  return (folder.st_mode & kBits) == kBits;
}

bool give_to_users(int fd, const fs::path& like, mode_t mode) {
  struct stat users {
  }, own{};
  if (::stat(like.c_str(), &users) != 0 || ::fstat(fd, &own) != 0) return false;
  const uid_t owner = ::geteuid() == 0 ? users.st_uid : own.st_uid;
  const gid_t group = is_shared(users) || ::geteuid() == 0 ? users.st_gid : own.st_gid;
  if ((owner != own.st_uid || group != own.st_gid) && ::fchown(fd, owner, group) == 0)
    own.st_gid = group;
  mode &= ~process_mask();
  if (is_shared(users) && own.st_gid == users.st_gid) mode |= (mode & S_IRWXU) >> 3;
  if (S_ISDIR(own.st_mode) && is_shared(users)) mode |= S_ISGID;
  return ::fchmod(fd, mode) == 0;
}

fs::path temporary_name(const fs::path& folder) {
  static std::atomic<unsigned> count{0};
  return folder / (this_process().text() + "." + std::to_string(++count));
}

Error cannot_write(const fs::path& file, int error) {
  return unwritable(file.string() + ": cannot be written: " + system_message(error));
}

Result<void> write_atomically(const AtomicFile& file, std::span<const std::uint8_t> bytes) {
  const fs::path folder = file.target.parent_path();
  if (auto ok = make_folder(folder, file.tmp); !ok) return ok;
  Temporary temporary(temporary_name(file.tmp));
  FileDescriptor fd(::open(temporary.name(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
  if (fd.get() < 0) return cannot_write(file.target, errno);
  failpoint("created");
  const std::span chars(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  const std::size_t half = bytes.size() / 2;
  if (!write_all(fd.get(), chars.first(half))) return cannot_write(file.target, errno);
  failpoint("half-written");
  if (!write_all(fd.get(), chars.subspan(half))) return cannot_write(file.target, errno);
  failpoint("written");
  if (!give_to_users(fd.get(), file.tmp, file.mode) || (file.is_synced && ::fsync(fd.get()) != 0) ||
      !fd.close())
    return cannot_write(file.target, errno);
  failpoint("synced");
  const auto back = read_file(temporary.path());
  if (!back || !std::ranges::equal(*back, bytes))
    return unwritable(file.target.string() + ": the bytes read back differ from those written");
  if (file.prove) {
    if (auto ok = file.prove(*back); !ok) return ok;
  }
  failpoint("proven");
  if (!temporary.rename_to(file.target)) return cannot_write(file.target, errno);
  failpoint("renamed");
  if (!file.is_synced) return {};
  auto synced = sync_folder(folder);
  failpoint("folder-synced");
  return synced;
}

Result<void> write_atomically(const AtomicFile& file, const std::string& text) {
  return write_atomically(file, text_bytes(text));
}

Result<std::vector<fs::path>> listed(const fs::path& folder) {
  std::vector<fs::path> out;
  std::error_code error;
  fs::directory_iterator one(folder, error);
  for (; !error && one != fs::directory_iterator(); one.increment(error))
    out.push_back(one->path());
  if (error) return refused_by_system(folder.string(), error.value());
  return out;
}

std::optional<nanoseconds> time_of(const fs::path& file) {
  struct stat status {};
  if (::lstat(file.c_str(), &status) != 0) return std::nullopt;
  return std::chrono::seconds(status.st_mtim.tv_sec) + nanoseconds(status.st_mtim.tv_nsec);
}

json entry_json(const ScanEntry& entry) {
  json out = {{"schema", "trocar.scan/1"},
              {"name", entry.name},
              {"status", entry.is_done() ? "done" : "failed"},
              {"key", entry.key.empty() ? json() : json(entry.key)},
              {"program", entry.program},
              {"parameters", entry.parameters},
              {"files", files_json(entry.files)}};
  if (!entry.series.empty()) out["series"] = entry.series;
  if (entry.outputs) {
    out["asset"] = object_json(entry.outputs->asset);
    out["report"] = object_json(entry.outputs->report);
    if (!entry.warnings.empty()) out["warnings"] = entry.warnings;
  }
  if (!entry.is_done()) {
    out["reason"] = entry.reason;
    out["exit_code"] = entry.exit_code;
    if (entry.signal != 0) out["signal"] = entry.signal;
    if (entry.is_lasting) out["lasting"] = true;
  }
  return out;
}

std::optional<ScanEntry> entry_from(std::string_view text) {
  const json value = parse_json(text);
  try {
    if (value.at("schema") != "trocar.scan/1") return std::nullopt;
    ScanEntry out;
    out.name = value.at("name").get<std::string>();
    if (!value.at("key").is_null()) {
      out.key = value.at("key").get<std::string>();
      if (!is_sha256(out.key)) return std::nullopt;
    }
    out.program = value.at("program").get<std::string>();
    out.parameters = value.at("parameters");
    out.series = value.value("series", "");
    auto files = files_from(value.at("files"));
    if (!files || !out.parameters.is_object()) return std::nullopt;
    out.files = std::move(*files);
    const bool is_done = value.at("status") == "done";
    if (is_done || value.contains("asset")) {
      if (out.key.empty()) return std::nullopt;
      out.outputs = Outputs{object_from(value.at("asset")), object_from(value.at("report"))};
      out.warnings = value.value("warnings", json::array());
      if (!out.warnings.is_array()) return std::nullopt;
      for (const json& warning : out.warnings)
        for (const char* member : {"code", "where", "sentence"})
          if (!warning.at(member).is_string()) return std::nullopt;
    }
    if (!is_done) {
      out.reason = value.at("reason").get<std::string>();
      out.exit_code = value.at("exit_code").get<int>();
      out.signal = value.value("signal", 0);
      out.is_lasting = value.value("lasting", false);
    }
    return out;
  } catch (const json::exception&) {
    return std::nullopt;
  }
}

Result<Store> Store::open_for_reading(const fs::path& folder) {
  std::error_code ignored;
  const auto marked = has_mark(folder);
  if (!marked) return marked.error();
  if (!*marked && fs::is_directory(folder, ignored)) {
    if (auto ok = check_empty(folder); !ok) return ok.error();
  }
  return Store(folder);
}

Result<Store> Store::open_for_writing(const fs::path& folder) {
  const Store store(folder);
  if (::mkdir(folder.c_str(), 0777) != 0 && errno != EEXIST) return cannot_write(folder, errno);
  const auto marked = has_mark(folder);
  if (!marked) return marked.error();
  if (!*marked) {
    if (auto ok = check_empty(folder); !ok) return ok.error();
  }
  if (auto ok = check_user(folder, store.tmp()); !ok) return ok.error();
  for (const char* name : kFolders) {
    if (auto ok = make_folder(folder / name, folder); !ok) return ok.error();
    if (::access((folder / name).c_str(), W_OK | X_OK) != 0)
      return cannot_write(folder / name, errno);
  }
  if (!*marked) {
    const std::string text = json_text({{"schema", kSchema}}) + "\n";
    if (auto ok = write_atomically({folder / kMark, store.tmp()}, text); !ok) return ok.error();
  }
  store.remove_strays();
  return store;
}

fs::path Store::action_file(const std::string& key) const {
  return folder_ / "actions" / (fanned_out(key) + ".json");
}
fs::path Store::content_file(const std::string& sha256) const {
  return folder_ / "content" / fanned_out(sha256);
}
fs::path Store::entry_file(const std::string& name) const {
  return folder_ / "scans" / (name + ".json");
}

bool Store::has(const Object& object) const {
  return is_there(content_file(object.sha256), object.bytes);
}

bool Store::lacks(const Object& object) const {
  struct stat status {};
  const bool is_found = ::stat(content_file(object.sha256).c_str(), &status) == 0;
  return is_found ? !has(object) : errno == ENOENT;
}

Result<std::optional<std::vector<Object>>> Store::outputs_of(const std::string& key) const {
  const auto outputs = outputs_in(action_file(key), key);
  if (!outputs) return outputs.error();
  if (outputs->is_null()) return std::optional<std::vector<Object>>();
  try {
    std::vector<Object> out;
    for (const auto& [name, output] : outputs->items())
      out.push_back(object_from(output));
    if (outputs->is_object() && !out.empty()) return std::optional(std::move(out));
  } catch (const json::exception&) {
  }
  return damaged(action_file(key));
}

std::optional<Outputs> Store::find(const std::string& key) const {
  try {
    const auto outputs = outputs_in(action_file(key), key);
    if (!outputs) return std::nullopt;
    Outputs out{object_from(outputs->at("asset")), object_from(outputs->at("report"))};
    if (!has(out)) return std::nullopt;
    return out;
  } catch (const json::exception&) {
    return std::nullopt;
  }
}

bool Store::renew(const std::string& key, const Outputs& outputs) const {
  return renew_time(action_file(key)) && renew_time(content_file(outputs.asset.sha256)) &&
         renew_time(content_file(outputs.report.sha256));
}

Result<Object> Store::put_content(
    std::span<const std::uint8_t> bytes,
    const std::function<Result<void>(std::span<const std::uint8_t>)>& prove) const {
  Object out{sha256_of(bytes), bytes.size()};
  const fs::path file = content_file(out.sha256);
  if (is_there(file, out.bytes) && renew_time(file)) return out;
  // write_atomically() compares the bytes that it reads back, so the file has the digest that its
  // name states.
  if (auto ok = write_atomically({file, tmp(), 0666, true, prove}, bytes); !ok) return ok.error();
  return out;
}

Result<void> Store::put_action(const std::string& key, const json& action,
                               const Outputs& outputs) const {
  const json value = {
      {"action", action},
      {"outputs",
       {{"asset", object_json(outputs.asset)}, {"report", object_json(outputs.report)}}}};
  return write_atomically({action_file(key), tmp(), kPrivate}, json_text(value, 1) + "\n");
}

Result<std::optional<ScanEntry>> Store::read_entry(const std::string& name) const {
  const auto text = text_of(entry_file(name));
  if (!text) return text.error();
  if (!*text) return std::optional<ScanEntry>();
  auto out = entry_from(**text);
  if (!out || out->name != name) return damaged(entry_file(name));
  return out;
}

std::optional<ScanEntry> Store::entry(const std::string& name) const {
  auto out = read_entry(name);
  return out ? std::move(*out) : std::nullopt;
}

std::vector<Store::Link> Store::links_of(const ScanEntry& entry) const {
  std::vector<Link> out = {{asset_link(folder_, entry.name), {}},
                           {report_link(folder_, entry.name), {}}};
  if (entry.outputs) {
    out[0].target = link_target(entry.outputs->asset);
    out[1].target = link_target(entry.outputs->report);
  }
  return out;
}

bool Store::links_fit(const ScanEntry& entry) const {
  const auto links = links_of(entry);
  return std::all_of(links.begin(), links.end(), [](const Link& one) {
    return one.target ? leads_to(one.link, *one.target) : is_absent(one.link);
  });
}

Result<void> Store::put_entry(const ScanEntry& entry) const {
  // The JSON is one line, because every later run reads all entries. The entry is not synced: if it
  // is lost, it is made again from the actions.
  if (auto ok = write_atomically({entry_file(entry.name), tmp(), kPrivate, false},
                                 json_text(entry_json(entry)) + "\n");
      !ok)
    return ok;
  for (const auto& [link, target] : links_of(entry)) {
    if (target) {
      if (auto ok = link_atomically(*target, link, tmp()); !ok) return ok;
    } else if (::unlink(link.c_str()) != 0 && errno != ENOENT) {
      return cannot_write(link, errno);
    }
  }
  return {};
}

Result<void> Store::drop_entry(const std::string& name) const {
  // The entry is removed last, because links without an entry would not be found again.
  ::unlink(asset_link(folder_, name).c_str());
  ::unlink(report_link(folder_, name).c_str());
  if (::unlink(entry_file(name).c_str()) != 0 && errno != ENOENT)
    return cannot_write(entry_file(name), errno);
  return {};
}

Result<std::vector<std::string>> Store::names() const {
  std::vector<std::string> out;
  if (is_absent(folder_ / "scans")) return out;
  const auto files = listed(folder_ / "scans");
  if (!files) return files.error();
  for (const fs::path& file : *files) {
    std::string name = file.filename().string();
    if (!name.ends_with(".json")) continue;
    name.resize(name.size() - 5);
    if (is_scan_name(name)) out.push_back(std::move(name));
  }
  std::sort(out.begin(), out.end());
  return out;
}

Result<nanoseconds> Store::now() const {
  const fs::path probe = temporary_name(tmp());
  const FileDescriptor fd(::open(probe.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
  if (fd.get() < 0) return cannot_write(probe, errno);
  const auto time = time_of(probe);
  ::unlink(probe.c_str());
  if (!time) return cannot_write(probe, ENOENT);
  return *time;
}

std::size_t Store::remove_strays() const {
  std::size_t removed = 0;
  std::optional<nanoseconds> now_here;  // determined only if needed
  const auto sweep =
      [&](const fs::path& folder, nanoseconds most,
          const std::function<std::optional<ProcessIdentity>(const fs::path&)>& identity_of) {
        std::error_code ignored;
        const auto files = listed(folder);
        if (!files) return;
        for (const fs::path& file : *files) {
          const auto process = identity_of(file);
          const Life life = process ? life_of(*process) : Life::kUnknown;
          if (life == Life::kAlive) continue;
          if (life == Life::kUnknown) {
            if (!now_here) {
              const auto asked = now();
              if (!asked) continue;
              now_here = *asked;
            }
            const auto time = time_of(file);
            if (!time || !is_abandoned(*time, *now_here, most)) continue;
          }
          if (fs::remove(file, ignored)) ++removed;
        }
      };
  sweep(tmp(), kStrayAge,
        [](const fs::path& file) { return identity_in(file.filename().string()); });
  sweep(folder_ / "claims", kLeaseDuration, [](const fs::path& file) {
    const auto text = text_of(file);
    return text && *text ? identity_in((*text)->substr(0, (*text)->find('\n'))) : std::nullopt;
  });
  return removed;
}

bool Journal::add(nlohmann::json line) {
  const ProcessIdentity me = this_process();
  if (!fd_ || fd_->get() < 0) {
    const std::string name =
        me.host + "-" + std::to_string(me.pid) + "-" + std::to_string(me.start) + ".ndjson";
    // Private, because reasons and warnings state the paths of the input, which may name patients.
    fd_.emplace(::open((folder_ / name).c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600));
    if (fd_->get() < 0 || !give_to_users(fd_->get(), folder_, 0600)) return false;
  }
  line["time"] = time_text();
  line["host"] = me.host;
  line["pid"] = me.pid;
  failpoint("journal");
  const std::string text = json_text(line) + "\n";
  return ::write(fd_->get(), text.data(), text.size()) == static_cast<ssize_t>(text.size());
}

}  // namespace trocar::farm
