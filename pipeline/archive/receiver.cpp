// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/archive/receiver.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <map>
#include <set>
#include <system_error>
#include <utility>
#include <vector>

#include "pipeline/archive/listening_socket.h"
#include "pipeline/archive/messages.h"
#include "pipeline/archive/study_folders.h"
#include "pipeline/base/number_ranges.h"
#include "pipeline/farm/processes.h"
#include "pipeline/read/dicom/dicom_parse.h"

namespace trocar::archive {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;

constexpr int kPollMs = 100;
constexpr std::chrono::seconds kRetry(5);
constexpr double kKeepCheckS = 1;  // time between two searches for studies that are too old

std::string megabytes(std::uint64_t bytes) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f MB", static_cast<double>(bytes) / 1e6);
  return text;
}

// Limits the memory of one association's process. A dataset stays in its file; DCMTK's parser may
// need 512 MiB for a deflated one. A sanitizer reserves far more memory than the limit.
void limit_memory() {
#ifndef TROCAR_SANITIZED
  constexpr rlim_t kMaxDataBytes = rlim_t{1536} << 20;
  const rlimit limit = {kMaxDataBytes, kMaxDataBytes};
  ::setrlimit(RLIMIT_DATA, &limit);
#endif
  const rlimit no_core = {0, 0};  // a core file would hold a patient's data
  ::setrlimit(RLIMIT_CORE, &no_core);
}

class Receiver {
 public:
  Receiver(const ReceiverSettings& settings, StudyFolders& folders, ListeningSocket& socket)
      : settings_(settings), folders_(folders), socket_(socket) {
    if (settings.then) {
      FollowUpSettings then = *settings.then;
      then.studies = fs::absolute(folders.folder());
      then.marks = folders.follow_up_marks();
      follow_up_.emplace(std::move(then));
    }
    // Studies that an earlier receiver could not publish any more.
    for (const std::string& study : folders_.growing())
      grown_[study] = Clock::now();
  }

  void run(const std::atomic<bool>& stop) {
    while (!stop.load()) {
      wait();
      collect();
      if (Clock::now() >= retry_) take_released();
      accept();
      publish_complete(settings_.settle_s);
      remove_old();
      if (follow_up_) follow_up_->step();
    }
    end_associations();
    take_released();  // without waiting for retry_
    publish_complete(0);
    for (const auto& [study, last] : grown_)
      if (cut_off_.contains(study))
        report("study " + study +
               ": not complete, because a sender was cut off; the next receiver publishes it");
  }

 private:
  struct Process {
    fs::path folder;
    int pipe = -1;  // at its end of file, the process has ended
  };

  bool has_room() const {
    return processes_.size() < static_cast<std::size_t>(settings_.max_associations);
  }

  void wait() const {
    std::vector<pollfd> polled;
    polled.reserve(processes_.size() + 1);
    if (has_room()) polled.push_back({socket_.fd(), POLLIN, 0});
    for (const auto& [pid, process] : processes_)
      polled.push_back({process.pipe, POLLIN, 0});
    ::poll(polled.data(), polled.size(), kPollMs);
  }

  void accept() {
    while (has_room()) {
      const int connection = socket_.accept();
      if (connection < 0) return;
      start(connection);
      ::close(connection);
    }
  }

  void start(int connection) {
    const auto folder = folders_.new_association();
    if (!folder) return report(folder.error().message);
    int ends[2];
    if (::pipe2(ends, O_CLOEXEC) != 0) {
      folders_.drop_association(*folder);
      return report(std::string("no association: ") + std::generic_category().message(errno));
    }
    const pid_t pid = farm::fork_with_signal(SIGKILL);
    if (pid == 0) {
      for (const int signal : {SIGINT, SIGTERM, SIGHUP})
        ::signal(signal, SIG_DFL);
      ::close(socket_.fd());
      limit_memory();
      ::_exit(static_cast<int>(
          serve_association(connection, *folder, folders_, settings_.association)));
    }
    ::close(ends[1]);
    if (pid < 0) {
      ::close(ends[0]);
      folders_.drop_association(*folder);
      return report(std::string("no association: ") + std::generic_category().message(errno));
    }
    processes_[pid] = {*folder, ends[0]};
  }

  // Takes the instances of the associations that have ended.
  void collect() {
    for (auto at = processes_.begin(); at != processes_.end();) {
      int status = 0;
      if (::waitpid(at->first, &status, WNOHANG) != at->first) {
        ++at;
        continue;
      }
      end(at->second, status);
      at = processes_.erase(at);
    }
  }

  void end(const Process& process, int status) {
    ::close(process.pipe);
    if (WIFEXITED(status) && WEXITSTATUS(status) == static_cast<int>(AssociationEnd::kReleased))
      return void(retry_ = Clock::now());
    folders_.drop_association(process.folder);
    if (WIFSIGNALED(status) && WTERMSIG(status) == SIGALRM) {
      report("an association was dropped: it took too long");
    } else if (WIFSIGNALED(status)) {
      report("an association ended by signal " + std::to_string(WTERMSIG(status)));
    } else if (WEXITSTATUS(status) == static_cast<int>(AssociationEnd::kDropped)) {
      report("an association was dropped: nothing of it is kept");
    } else if (WEXITSTATUS(status) != static_cast<int>(AssociationEnd::kRejected)) {
      report("an association ended with exit code " + std::to_string(WEXITSTATUS(status)));
    }
  }

  // Takes the instances of released associations. If the disk is full, run() tries again after a
  // while.
  void take_released() {
    for (const fs::path& folder : folders_.released())
      if (!take(folder)) retry_ = Clock::now() + kRetry;
  }

  bool take(const fs::path& folder) {
    const auto taken = folders_.take(folder, settings_.association.limits);
    if (!taken) {
      report(taken.error().message);
      return false;
    }
    for (const TakenStudy& study : *taken) {
      if (study.added > 0) grown_[study.uid] = Clock::now();
      report_left_out(study.uid, study.different, study.excess);
    }
    return true;
  }

  static void report_left_out(const std::string& study, std::size_t different, std::size_t excess) {
    if (different > 0)
      report("study " + study + ": " + std::to_string(different) +
             " instances left out: others with the same UIDs are stored");
    if (excess > 0)
      report("study " + study + ": " + std::to_string(excess) +
             " instances left out: the study is full (--max-instances, --max-study-gb)");
  }

  bool is_open(const std::string& study) const {
    std::error_code ignored;
    for (const auto& [pid, process] : processes_)
      if (fs::exists(process.folder / study, ignored)) return true;
    for (const fs::path& folder : folders_.released())
      if (fs::exists(folder / study, ignored)) return true;
    return false;
  }

  void publish_complete(double settle_s) {
    const auto now = Clock::now();
    for (auto at = grown_.begin(); at != grown_.end();) {
      const std::string study = at->first;
      if (Seconds(now - at->second).count() < settle_s || is_open(study) ||
          cut_off_.contains(study)) {
        ++at;
      } else if (publish(study)) {
        at = grown_.erase(at);
      } else {
        at->second = now;  // tried again after a while
        ++at;
      }
    }
  }

  bool publish(const std::string& study) {
    if (follow_up_) follow_up_->expect(study);
    const auto done = folders_.publish(folders_.growing_folder(study), study);
    if (!done) {
      report("study " + study + ": " + done.error().message);
      return false;
    }
    report_left_out(study, done->different, 0);
    if (done->added == 0) return true;
    const bool is_extended = done->added < done->instances;
    announce("study " + study + ": " + std::to_string(done->instances) + " instances" +
             (is_extended ? ", " + std::to_string(done->added) + " of them new" : "") + ", " +
             megabytes(done->bytes));
    if (follow_up_) follow_up_->add(study);
    return true;
  }

  void remove_old() {
    if (settings_.keep_hours <= 0) return;
    const auto now = Clock::now();
    if (Seconds(now - kept_).count() < kKeepCheckS) return;
    kept_ = now;
    const auto busy = follow_up_ ? follow_up_->busy() : std::set<std::string>();
    for (const std::string& study : folders_.remove_older(settings_.keep_hours, busy))
      announce("study " + study + ": removed after " + pipeline::text_of(settings_.keep_hours, 6) +
               " h");
  }

  void end_associations() {
    collect();
    for (const auto& [pid, process] : processes_)
      ::kill(pid, SIGKILL);
    for (const auto& [pid, process] : processes_) {
      while (::waitpid(pid, nullptr, 0) < 0 && errno == EINTR) {
      }
      ::close(process.pipe);
      // If the process had released its association, the folder is no longer there.
      cut_off_.merge(StudyFolders::studies_in(process.folder));
      folders_.drop_association(process.folder);
    }
    processes_.clear();
  }

  const ReceiverSettings& settings_;
  StudyFolders& folders_;
  ListeningSocket& socket_;
  std::optional<FollowUp> follow_up_;
  std::map<pid_t, Process> processes_;
  std::map<std::string, Clock::time_point> grown_;  // studies to publish, and their last instance
  std::set<std::string> cut_off_;  // studies that an association was sending when run() ended it
  Clock::time_point kept_ = Clock::now();
  Clock::time_point retry_ = Clock::now();  // when released associations are taken next
};

}  // namespace

Result<void> run_receiver(const ReceiverSettings& settings, const std::atomic<bool>& stop) {
  auto socket = ListeningSocket::open(settings.address, settings.port);
  if (!socket) return socket.error();
  auto folders = StudyFolders::open(settings.folder);
  if (!folders) return folders.error();
  if (const auto ok = folders->reserve(); !ok) return ok.error();
  pipeline::set_up_dcmtk();  // before the processes fork, so that they need not
  announce("listening on " + settings.address + " port " + std::to_string(socket->port()) + " as " +
           settings.association.ae + (settings.association.tls ? ", with TLS" : ", unencrypted"));
  announce("studies stay in " + settings.folder.string() +
           (settings.keep_hours > 0 ? " for " + pipeline::text_of(settings.keep_hours, 6) +
                                          " hours, then they are removed"
                                    : " until you remove them"));
  Receiver(settings, *folders, *socket).run(stop);
  return {};
}

}  // namespace trocar::archive
