// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/archive/follow_up.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <system_error>
#include <utility>

#include "formats/base/file_io.h"
#include "formats/base/json_text.h"
#include "pipeline/archive/archive_names.h"
#include "pipeline/archive/messages.h"
#include "pipeline/farm/atomic_file.h"
#include "pipeline/farm/collection.h"
#include "pipeline/farm/processes.h"
#include "pipeline/farm/sha256.h"
#include "pipeline/open/scan_list.h"

namespace trocar::archive {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using nlohmann::ordered_json;

constexpr std::size_t kDigestDigits = 12;
constexpr int kNothingUsable = 30;  // exit code of a follow-up without a scan to mesh

// `listed` is the scan in the list of the study, and `scan` its entry in a collection. Only DICOM
// series have a UID; several volumes have the same. The input of a series with one file is that file, whose name must not matter:
// more files of the series may arrive later.
std::string scan_name(const std::string& study, const json& listed, const json& scan) {
  const auto uid = listed.find("uid");
  std::string of = uid != listed.end()
                       ? uid->get<std::string>()
                       : fs::path(scan["input"].get<std::string>()).filename().string();
  if (listed.contains("volume")) of += " " + json_text(listed["volume"]);
  return study + "_" + farm::sha256_of(of).substr(0, kDigestDigits);
}

// Adds the study's scans to the collection's file, and gives their names.
Result<std::vector<std::string>> add_to_collection(const fs::path& folder, const fs::path& file) {
  std::vector<pipeline::Warning> ignored_warnings;
  const auto list = pipeline::list_scans(folder, ignored_warnings);
  if (!list) return list.error();
  std::string text;
  std::error_code error;
  if (fs::exists(file, error)) {
    const auto bytes = read_file(file);
    if (!bytes) return bytes.error();
    text.assign(bytes->begin(), bytes->end());
  }
  const fs::path base = file.parent_path();
  std::vector<std::string> names;
  const auto collection =
      with_study(text, file, *list, folder, base, folder.filename().string(), names);
  if (!collection) return collection.error();
  if (names.empty()) return names;
  const auto written =
      farm::write_atomically({.target = file, .tmp = base}, json_text(*collection, 1) + "\n");
  if (!written) return written.error();
  return names;
}

// Replaces this process by a batch of the named scans. This program is in libexec/trocar, and
// trocar-mesh is in bin beside libexec.
int run_batch_program(const FollowUpSettings& settings, const std::vector<std::string>& names) {
  const int fd = ::memfd_create("scans", 0);
  std::string text;
  for (const std::string& name : names)
    text += name + "\n";
  if (fd < 0 || ::write(fd, text.data(), text.size()) != static_cast<ssize_t>(text.size()) ||
      ::lseek(fd, 0, SEEK_SET) != 0 || ::dup2(fd, STDIN_FILENO) < 0)
    return static_cast<int>(ExitCode::kUnwritable);
  std::array<std::string, 8> words = {"trocar-mesh",
                                      "batch",
                                      settings.collection.string(),
                                      "-o",
                                      settings.store.string(),
                                      "--only",
                                      "-",
                                      "--quiet"};
  std::array<char*, 9> arguments{};
  std::transform(words.begin(), words.end(), arguments.begin(),
                 [](std::string& word) { return word.data(); });
  std::error_code unreadable;
  const fs::path own = fs::read_symlink("/proc/self/exe", unreadable);
  const fs::path program = own.parent_path().parent_path().parent_path() / "bin" / "trocar-mesh";
  ::execv(program.c_str(), arguments.data());
  report(program.string() + ": cannot be run (" + std::generic_category().message(errno) + ")");
  return static_cast<int>(ExitCode::kBug);
}

int follow_up(const FollowUpSettings& settings, const fs::path& folder) {
  ::umask(settings.umask);
  const auto names = add_to_collection(folder, settings.collection);
  if (!names) {
    report(names.error().message);
    return static_cast<int>(names.error().code);
  }
  return names->empty() ? kNothingUsable : run_batch_program(settings, *names);
}

}  // namespace

Result<ordered_json> with_study(std::string_view text, const fs::path& file, const json& list,
                                const fs::path& folder, const fs::path& base,
                                const std::string& study, std::vector<std::string>& names) {
  ordered_json out = {
      {"schema", "trocar.collection/1"}, {"defaults", json::object()}, {"scans", json::array()}};
  if (!text.empty()) {
    if (const auto read = farm::parse_collection(text, file); !read) return read.error();
    out = ordered_json::parse(text);
  }
  ordered_json& scans = out["scans"];
  for (const json& listed : list["scans"]) {
    json alone = {{"scans", json::array()}};
    alone["scans"].push_back(listed);
    const json found = farm::first_collection(alone, folder, base);
    if (found["scans"].empty()) continue;  // it is not usable, or a localiser
    const json& scan = found["scans"][0];
    const std::string name = scan_name(study, listed, scan);
    names.push_back(name);
    ordered_json entry = {{"name", name}, {"input", scan["input"]}};
    if (scan.contains("parameters")) entry["parameters"] = scan["parameters"];
    const auto at = std::find_if(scans.begin(), scans.end(),
                                 [&](const ordered_json& other) { return other["name"] == name; });
    if (at != scans.end()) {
      // Keeps what the user has given to this scan.
      for (const char* given : {"parameters", "products"})
        if (at->contains(given)) entry[given] = (*at)[given];
      *at = std::move(entry);
    } else {
      scans.push_back(std::move(entry));
    }
  }
  return out;
}

FollowUp::FollowUp(FollowUpSettings settings) : settings_(std::move(settings)) {
  std::error_code error;
  for (fs::directory_iterator at(settings_.marks, error), end; !error && at != end;
       at.increment(error))
    if (is_uid(at->path().filename().string())) add(at->path().filename().string());
}

FollowUp::~FollowUp() {
  if (process_ == 0) return;
  ::kill(process_, SIGTERM);
  while (::waitpid(process_, nullptr, 0) < 0 && errno == EINTR) {
  }
}

void FollowUp::expect(const std::string& study) const {
  const int fd = ::open((settings_.marks / study).c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
  if (fd >= 0) ::close(fd);
}

void FollowUp::add(const std::string& study) {
  std::error_code ignored;
  if (fs::is_directory(settings_.studies / study, ignored)) {
    waiting_.push_back(study);
  } else {
    fs::remove(settings_.marks / study, ignored);
  }
}

std::set<std::string> FollowUp::busy() const {
  std::set<std::string> out(waiting_.begin(), waiting_.end());
  if (process_ != 0) out.insert(current_);
  return out;
}

void FollowUp::report_end(int status) const {
  const std::string study = "study " + current_ + ": ";
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) {
    announce(study + "its assets are in " + settings_.store.string());
  } else if (WIFEXITED(status) && WEXITSTATUS(status) == kNothingUsable) {
    report(study + "it has no scan that can be meshed");
  } else {
    report(study + "its batch failed " +
           (WIFEXITED(status) ? "(exit code " + std::to_string(WEXITSTATUS(status)) + ")"
                              : "(signal " + std::to_string(WTERMSIG(status)) + ")"));
  }
}

void FollowUp::step() {
  if (process_ != 0) {
    int status = 0;
    if (::waitpid(process_, &status, WNOHANG) != process_) return;
    process_ = 0;
    report_end(status);
    std::error_code ignored;
    if (std::find(waiting_.begin(), waiting_.end(), current_) == waiting_.end())
      fs::remove(settings_.marks / current_, ignored);
  }
  if (waiting_.empty()) return;
  current_ = waiting_.front();
  const pid_t pid = farm::fork_with_signal(SIGTERM);
  if (pid < 0) return;  // tried again at the next step
  if (pid == 0) {
    for (const int signal : {SIGINT, SIGTERM, SIGHUP})
      ::signal(signal, SIG_DFL);
    ::_exit(follow_up(settings_, settings_.studies / current_));
  }
  process_ = pid;
  waiting_.pop_front();
}

}  // namespace trocar::archive
