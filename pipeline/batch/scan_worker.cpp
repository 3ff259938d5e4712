// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/batch/scan_worker.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <algorithm>
#include <array>
#include <csignal>
#include <cstdio>
#include <iterator>
#include <map>
#include <new>
#include <set>

#include "formats/asset/asset.h"
#include "formats/base/json.h"
#include "pipeline/batch/lease.h"

namespace trocar::farm {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

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

// Calls fork(). If this process dies, the new process gets the signal, or ends if it has not begun
// yet. The new process may have been forked from a process with threads.
pid_t fork_with_signal(int signal) {
  const pid_t parent = ::getpid();
  const pid_t pid = ::fork();
  if (pid != 0) return pid;
  ::prctl(PR_SET_PDEATHSIG, signal);
  if (::getppid() != parent) ::_exit(1);  // the parent died before prctl()
  return 0;
}

constexpr std::array<const char*, 6> kOutcomes = {"made",          "found",  "failed",
                                                  "known_failure", "leased", "interrupted"};

// Takes over the digests from the index if no file has changed.
void reuse_digests(const std::vector<ScanFile>& known, std::vector<ScanFile>& files) {
  if (!same_state(known, files)) return;
  for (std::size_t k = 0; k < files.size(); ++k)
    files[k].sha256 = known[k].sha256;
}

std::uint64_t bytes_read(const std::vector<ScanFile>& files) {
  std::uint64_t out = 0;
  for (const ScanFile& file : files)
    out += file.sha256.empty() ? 0 : file.size;
  return out;
}

// Checks that the bytes are a valid asset.
Result<void> check_asset(std::span<const std::uint8_t> glb, const std::string& name) {
  const auto asset = decode_asset(glb, name);
  if (!asset) return asset.error();
  return verify_asset(*asset, name);
}

// Removes a content file if its bytes do not have the digest in its name, or if it should be an
// asset and is not a valid one.
void remove_damaged(const Store& store, const Object& object, bool is_asset) {
  const fs::path file = store.content_file(object.sha256);
  const auto bytes = read_file(file);
  const bool is_whole = bytes && sha256_of(*bytes) == object.sha256 &&
                        (!is_asset || check_asset(*bytes, file.string()));
  if (!is_whole) ::unlink(file.c_str());
}

// Gives an entry of a failure that may pass what the entry before has: the key, so that --gc keeps
// what belongs to it, and the outputs if they still exist, so that their links stay. A scan whose key
// is known to be another one now keeps nothing.
void keep_results(const Store& store, const std::optional<ScanEntry>& before, ScanEntry& entry) {
  if (!before || (!entry.key.empty() && entry.key != before->key)) return;
  entry.key = before->key;
  const auto& outputs = before->outputs;
  if (outputs && !store.lacks(outputs->asset) && !store.lacks(outputs->report))
    entry.outputs = outputs, entry.warnings = before->warnings;
}

// A new link to a file, or other rights, change its ctime alone. Then the bytes decide, if they were
// read before.
bool has_same_bytes(ScanFile now, const ScanFile& before) {
  if (same_state(now, before)) return true;
  now.ctime_ns = before.ctime_ns;
  if (!same_state(now, before)) return false;
  if (before.sha256.empty()) return true;
  const auto digest = sha256_of_file(now.path);
  return digest && *digest == before.sha256;
}

// What an entry keeps of warnings.
json brief(const json& warnings) {
  json out = json::array();
  for (const json& warning : warnings) {
    if (!warning.is_object()) continue;
    json one = json::object();
    for (const char* text : {"code", "where", "sentence"})
      one[text] = warning.value(text, "");
    out.push_back(std::move(one));
  }
  return out;
}

// The report with the warnings of opening before its own, without names of files.
std::string with_warnings(const std::string& report, const json& opening) {
  json out = parse_json(report);
  if (opening.empty() || !out.is_object() || !out.contains("warnings")) return report;
  json all = json::array();
  for (const json& warning : opening)
    all.push_back({{"code", warning["code"]},
                   {"where", "input"},
                   {"sentence", warning.value("shared", warning["sentence"].get<std::string>())}});
  for (json& warning : out["warnings"])
    all.push_back(std::move(warning));
  out["warnings"] = std::move(all);
  return json_text(out, 1) + "\n";
}

// The steps of the work on one scan.
class Worker {
 public:
  Worker(const Work& work, const Store& store, const ScanProgram& program)
      : work_(work), scan_(*work.wanted.scan), store_(store), program_(program) {
    entry_.name = scan_.name;
    entry_.program = program.digest();
    entry_.series = scan_.series;
    entry_.parameters = json::object();
  }

  // An error is recorded as the scan's failure.
  Result<Outcome::Kind> run() {
    const auto known = store_.read_entry(scan_.name);
    if (!known && known.error().is_temporary) return known.error();
    if (known) known_ = *known;
    if (work_.wanted.parameters == nullptr) {
      const auto again = program_.parameters(scan_.parameters);
      return again ? bug("parameters that were refused are accepted now") : again.error();
    }
    entry_.parameters = work_.wanted.parameters->canonical;
    const auto inputs = inputs_of(scan_);
    if (!inputs) return inputs.error();
    paths_ = all_paths(*inputs, *work_.wanted.parameters);
    if (const auto ok = list_files(paths_).into(entry_.files); !ok) return ok.error();
    is_listed_ = !entry_.files.empty();
    let_times_settle(entry_.files);
    if (known_ && !work_.rehash) reuse_digests(known_->files, entry_.files);
    std::vector<NamedFile> wanted = paths_;
    opens_first_ = program_.opens_first(*inputs, *work_.wanted.parameters);
    if (opens_first_) {
      if (auto ok = open(*inputs); !ok) return ok.error();
      wanted = opened_->files();
    }
    if (auto ok = digest_files(wanted, entry_.files); !ok) return ok.error();
    failpoint("digested");
    if (auto ok = check_unchanged(); !ok) return ok.error();
    action_ = action_of(entry_.program, entry_.parameters, wanted, entry_.files);
    entry_.key = key_of(action_);
    if (known_ && known_->is_lasting && !work_.retry &&
        (known_->key == entry_.key || (!opened_ && known_->key == unopened_key())))
      return put_known_failure();
    return find_or_make(*inputs);
  }

  // Writes a failure to the entry and to the index.
  Outcome fail(const Error& error) {
    entry_.reason = error.message;
    entry_.exit_code = static_cast<int>(error.code);
    entry_.outputs.reset();
    entry_.warnings = json::array();
    entry_.is_lasting = is_lasting(error);
    const bool is_known = entry_.is_lasting && !work_.retry && known_ && known_->is_lasting &&
                          known_->key == entry_.key && known_->program == entry_.program &&
                          known_->parameters == entry_.parameters &&
                          known_->reason == entry_.reason;
    Outcome out;
    out.key = entry_.key;
    out.kind = is_known ? Outcome::Kind::kKnownFailure : Outcome::Kind::kFailed;
    out.reason = entry_.reason;
    out.exit_code = entry_.exit_code;
    const auto before = store_.read_entry(scan_.name);  // this run may have written it
    out.is_recorded = false;
    if (!before && !entry_.is_lasting) return out;  // see record_killed()
    known_ = before ? *before : std::nullopt;
    if (!entry_.is_lasting) keep_results(store_, known_, entry_);
    out.is_recorded = static_cast<bool>(put_changed_entry());
    return out;
  }

  const ScanEntry& entry() const { return entry_; }

 private:
  // Does the same scan always fail for this reason, and can state_of() see that it is the same? It
  // lists the files itself, so that it needs no key for a scan whose files cannot be listed. A scan
  // that could not be opened gets the key of such a failure.
  bool is_lasting(const Error& error) {
    if (error.is_temporary || (error.code != ExitCode::kUsage && error.code != ExitCode::kRefused))
      return false;
    // The input of a scan that was done before is more likely out of reach than gone, for example
    // on a file system that is not mounted. The folder where it would be mounted is empty then.
    if (!is_listed_) return !known_ || known_->is_lasting;
    if (!reads_the_same() || !fails_again(error)) return false;
    if (!entry_.key.empty() && !is_unopened_) return true;
    if (!digest_files(listed_files(), entry_.files) || !check_unchanged()) return false;
    entry_.key = unopened_key();
    return true;
  }

  // Does a second try end in the same way? An error of the storage that has passed can look like a
  // damaged file, because not every library tells them apart.
  bool fails_again(const Error& error) try {
    opened_.reset();
    const auto inputs = inputs_of(scan_);
    if (!inputs) return false;
    const auto again = program_.open(scan_.parameters, *inputs, scan_.series, work_.threads);
    if (!again) return again.error().message == error.message;
    const auto outputs = (*again)->mesh();
    return !outputs && outputs.error().message == error.message;
  } catch (const std::exception&) {
    return false;
  }

  // Can the files whose digests are known be read now, and do they have these digests? A digest may
  // be that of an earlier run, so that the failure may come from a file that cannot be read.
  bool reads_the_same() const {
    std::vector<ScanFile> now = entry_.files;
    std::vector<NamedFile> read;
    for (ScanFile& file : now) {
      if (file.sha256.empty()) continue;
      read.push_back({file.of, file.path});
      file.sha256.clear();
    }
    if (!digest_files(read, now)) return false;
    return std::equal(now.begin(), now.end(), entry_.files.begin(), entry_.files.end(),
                      [](const ScanFile& a, const ScanFile& b) { return a.sha256 == b.sha256; });
  }

  std::vector<NamedFile> listed_files() const {
    std::vector<NamedFile> out;
    out.reserve(entry_.files.size());
    for (const ScanFile& file : entry_.files)
      out.push_back({file.of, file.path});
    return out;
  }

  // The key of the failure of a scan that could not be opened. It is not known which files belong
  // to the scan, so that all of them count. Whether a scan can be opened, and which series of it,
  // depends on the series that is asked for and on the names of the files, too. Precondition: all
  // files have digests.
  std::string unopened_key() const {
    const std::vector<NamedFile> all = listed_files();
    json action = action_of(entry_.program, entry_.parameters, all, entry_.files);
    json names = json::array();
    for (const NamedFile& file : all)
      names.push_back(file.path.filename().string());
    action["unopened"] = {{"series", entry_.series}, {"names", std::move(names)}};
    return key_of(action);
  }

  Result<Outcome::Kind> put_known_failure() {
    entry_.key = known_->key;
    entry_.reason = known_->reason;
    entry_.exit_code = known_->exit_code;
    entry_.is_lasting = true;
    if (auto ok = put_changed_entry(); !ok) return ok.error();
    return Outcome::Kind::kKnownFailure;
  }

  Result<void> open(const std::vector<fs::path>& inputs) {
    auto opened = program_.open(scan_.parameters, inputs, scan_.series, work_.threads);
    is_unopened_ = !opened;
    if (!opened) return opened.error();
    opened_ = std::move(*opened);
    opening_ = opened_->warnings();
    return {};
  }

  // Refuses a scan whose files changed after they were listed: its digests and its mesh would be
  // those of different states.
  Result<void> check_unchanged() const {
    const auto now = list_files(paths_);
    if (!now)
      return refused_for_now(now.error().message + "; it existed when the work on this scan began");
    if (same_state(*now, entry_.files)) return {};
    std::string changed = now->size() == entry_.files.size() ? "" : "a file was added or removed";
    for (std::size_t k = 0; k < std::min(now->size(), entry_.files.size()); ++k) {
      if (has_same_bytes((*now)[k], entry_.files[k])) continue;
      changed = entry_.files[k].path;
      break;
    }
    if (changed.empty()) return {};
    return refused_for_now(changed +
                           ": changed while the scan was read; run again when it is complete");
  }

  Result<Outcome::Kind> find_or_make(const std::vector<fs::path>& inputs) {
    // A concurrent --gc can remove found outputs before the index refers to them.
    for (int attempt = 0; attempt < 3; ++attempt) {
      auto found = store_.find(entry_.key);
      if (found && work_.verify) {
        remove_damaged(store_, found->asset, true);
        remove_damaged(store_, found->report, false);
        if (known_ && known_->outputs) remove_damaged(store_, known_->outputs->report, false);
        found = store_.find(entry_.key);
      }
      Outcome::Kind kind = Outcome::Kind::kFound;
      if (!found || !store_.renew(entry_.key, *found)) {
        const auto lease = Lease::take(store_, entry_.key, scan_.name);
        if (!lease) return lease.error();
        if (*lease == nullptr) return Outcome::Kind::kLeased;
        // The previous holder of the lease may have finished.
        found = store_.find(entry_.key);
        if (!found || !store_.renew(entry_.key, *found)) {
          if (const auto ok = make(inputs).into(found); !ok) return ok.error();
          kind = Outcome::Kind::kMade;
        }
        failpoint("action-done");
      }
      const auto report = read_file(store_.content_file(found->report.sha256));
      if (!report) continue;
      if (auto ok = put_entry(*found, {report->begin(), report->end()}); !ok) return ok.error();
      if (store_.has(*found) && store_.has(*entry_.outputs)) return kind;
    }
    return unwritable(store_.folder().string() +
                      ": another process removes its files while they are written");
  }

  // Writes the entry of a scan with these outputs of its action, whose report is given. The entry has
  // all warnings. If the scan was opened before its key was known, the warnings of opening do not
  // follow from the key. Then the report of the scan is that of the action with these warnings added.
  Result<void> put_entry(const Outputs& outputs, const std::string& report) {
    entry_.outputs = outputs;
    entry_.warnings = json::array();
    if (opens_first_) {
      entry_.warnings = brief(opening_);
      auto own = store_.put_content(text_bytes(with_warnings(report, opening_)), {});
      if (!own) return own.error();
      entry_.outputs->report = *own;
    }
    if (const json read = parse_json(report); read.is_object() && read.contains("warnings"))
      for (json& warning : brief(read["warnings"]))
        entry_.warnings.push_back(std::move(warning));
    return put_changed_entry();
  }

  // An entry with the same contents stays untouched.
  Result<void> put_changed_entry() const {
    if (known_ && store_.links_fit(entry_) && entry_json(*known_) == entry_json(entry_)) return {};
    return store_.put_entry(entry_);
  }

  Result<Outputs> make(const std::vector<fs::path>& inputs) {
    if (!opened_) {
      if (auto ok = open(inputs); !ok) {
        // A file that is still being written is often refused. Then the reported reason is that the
        // file changed.
        if (auto same = check_unchanged(); !same) return same.error();
        return ok.error();
      }
    }
    failpoint("opened");
    auto outputs = opened_->mesh();
    failpoint("meshed");
    if (auto ok = check_unchanged(); !ok) return ok.error();
    if (!outputs) return outputs.error();
    opened_.reset();
    Outputs out;
    const std::string text =
        opens_first_ ? outputs->report : with_warnings(outputs->report, opening_);
    if (const auto ok = store_.put_content(text_bytes(text), {}).into(out.report); !ok)
      return ok.error();
    auto asset = store_.put_content(outputs->asset, [this](std::span<const std::uint8_t> glb) {
      return check_asset(glb, scan_.name);
    });
    if (!asset) return asset.error();
    out.asset = *asset;
    if (auto ok = store_.put_action(entry_.key, action_, out); !ok) return ok.error();
    return out;
  }

  const Work& work_;
  const CollectionScan& scan_;
  const Store& store_;
  const ScanProgram& program_;
  ScanEntry entry_;
  std::optional<ScanEntry> known_;  // the entry in the index before this run
  std::vector<NamedFile> paths_;    // of all inputs and of the files that options name
  bool is_listed_ = false;          // true: the entry has the files of all paths, at least one
  bool is_unopened_ = false;        // true: the scan could not be opened
  bool opens_first_ = false;        // true: the scan is opened before its key is known
  json action_, opening_ = json::array();  // opening_: the warnings of opening the scan
  std::unique_ptr<OpenedScan> opened_;
};

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

Processes::~Processes() {
  signal_all(SIGKILL);
  for (const Running& one : running_)
    ::waitpid(one.pid, nullptr, 0);
}

Result<void> Processes::start(std::size_t task, const std::function<std::string()>& work) {
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0)
    return bug("cannot create a pipe for a scan's process: " + system_message(errno));
  FileDescriptor from(ends[0]), to(ends[1]);
  std::fflush(nullptr);
  const pid_t pid = fork_with_signal(SIGKILL);
  if (pid < 0) return bug("cannot create a process for a scan: " + system_message(errno));
  if (pid == 0) {
    from.close();
    running_.clear();
    write_all(to.get(), work());
    std::fflush(nullptr);
    ::_exit(0);  // without the destructors of the parent's objects
  }
  running_.push_back({task, pid, std::move(from), {}, std::chrono::steady_clock::now()});
  return {};
}

std::optional<Ended> Processes::wait(std::chrono::milliseconds most) {
  std::vector<pollfd> waiting;
  for (const Running& one : running_)
    waiting.push_back({one.fd.get(), POLLIN, 0});
  if (::poll(waiting.data(), waiting.size(), static_cast<int>(most.count())) <= 0)
    return std::nullopt;
  for (std::size_t k = 0; k < waiting.size(); ++k) {
    if (waiting[k].revents == 0) continue;
    std::array<char, 4096> block{};
    const ssize_t got = ::read(running_[k].fd.get(), block.data(), block.size());
    if (got > 0) running_[k].text.append(block.data(), static_cast<std::size_t>(got));
    if (got > 0 || (got < 0 && errno == EINTR)) continue;
    Running one = std::move(running_[k]);
    running_.erase(running_.begin() + static_cast<std::ptrdiff_t>(k));
    one.fd.close();
    int status = 0;
    rusage used{};
    while (::wait4(one.pid, &status, 0, &used) < 0 && errno == EINTR) {
    }
    Ended out;
    out.memory_bytes = static_cast<std::uint64_t>(used.ru_maxrss) * 1024;
    out.task = one.task;
    out.text = one.text;
    if (WIFSIGNALED(status)) out.signal = WTERMSIG(status);
    if (WIFEXITED(status)) out.exit_code = WEXITSTATUS(status);
    out.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - one.start).count();
    return out;
  }
  return std::nullopt;
}

void Processes::signal_all(int signal) const {
  for (const Running& one : running_)
    ::kill(one.pid, signal);
}

const char* outcome_name(Outcome::Kind kind) {
  return kOutcomes.at(static_cast<std::size_t>(kind));
}

Outcome work_on(const Work& work, const Store& store, const ScanProgram& program) {
  Worker worker(work, store, program);
  Result<Outcome::Kind> done = Outcome::Kind::kFailed;
  try {
    done = worker.run();
  } catch (const std::bad_alloc&) {
    done = refused_for_now("not enough memory for this input");
  } catch (const std::exception& failure) {
    done = bug(std::string("internal error: ") + failure.what());
  }
  Outcome out;
  if (!done && work.stop != nullptr && work.stop->load()) {
    out.kind = Outcome::Kind::kInterrupted;
    out.key = worker.entry().key;
  } else if (!done) {
    out = worker.fail(done.error());
  } else {
    out.kind = *done;
    out.key = worker.entry().key;
    out.reason = worker.entry().reason;
    out.exit_code = worker.entry().exit_code;
    if (worker.entry().outputs) out.bytes = worker.entry().outputs->asset.bytes;
  }
  out.input_bytes = bytes_read(worker.entry().files);
  if (done) out.warnings = worker.entry().warnings;
  return out;
}

Outcome record_killed(const Work& work, const Store& store, const ScanProgram& program, int signal,
                      int exit_code) {
  ScanEntry entry;
  entry.name = work.wanted.scan->name;
  entry.program = program.digest();
  entry.series = work.wanted.scan->series;
  entry.parameters =
      work.wanted.parameters == nullptr ? json::object() : work.wanted.parameters->canonical;
  entry.signal = signal;
  entry.exit_code = signal != 0 ? 128 + signal : exit_code;
  const char* const name = signal == 0 ? nullptr : ::sigabbrev_np(signal);
  entry.reason = signal == 0 ? "its process ended without a result, with exit code " +
                                   std::to_string(exit_code)
                             : "its process was killed by signal " + std::to_string(signal) +
                                   (name == nullptr ? "" : " (SIG" + std::string(name) + ")");
  Outcome out;
  out.reason = entry.reason;
  out.exit_code = entry.exit_code;
  out.signal = signal;
  // An entry that cannot be read may name an asset. It stays, so that --gc stops at it.
  const auto before = store.read_entry(entry.name);
  out.is_recorded = false;
  if (!before) return out;
  keep_results(store, *before, entry);
  out.is_recorded = static_cast<bool>(store.put_entry(entry));
  return out;
}

}  // namespace trocar::farm
