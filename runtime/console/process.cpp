// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/process.h"

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>
#include <cerrno>
#include <charconv>
#include <csignal>
#include <fstream>
#include <iterator>

extern "C" {  // glibc 2.36 leaves it to who includes it
#include <sys/pidfd.h>
}

namespace trocar::runtime {

Result<Process> Process::start(const std::vector<std::string>& arguments,
                               const std::filesystem::path& log) {
  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawnattr_init(&attributes);
  ::posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  ::posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, log.c_str(),
                                     O_WRONLY | O_CREAT | O_APPEND | O_NOFOLLOW, 0600);
  ::posix_spawn_file_actions_adddup2(&actions, STDOUT_FILENO, STDERR_FILENO);
  ::posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
  sigset_t all, none;
  ::sigfillset(&all);
  ::sigemptyset(&none);
  ::posix_spawnattr_setsigdefault(&attributes, &all);
  ::posix_spawnattr_setsigmask(&attributes, &none);
  ::posix_spawnattr_setpgroup(&attributes, 0);
  ::posix_spawnattr_setflags(
      &attributes, POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETPGROUP);
  std::vector<char*> words;
  words.reserve(arguments.size() + 1);
  for (const std::string& word : arguments)
    words.push_back(const_cast<char*>(word.c_str()));  // posix_spawn does not write to them
  words.push_back(nullptr);
  pid_t pid = 0;
  const int error =
      ::posix_spawn(&pid, arguments.front().c_str(), &actions, &attributes, words.data(), environ);
  ::posix_spawn_file_actions_destroy(&actions);
  ::posix_spawnattr_destroy(&attributes);
  if (error != 0)
    return refused(arguments.front() + ": cannot be started: " + system_message(error));
  const int fd = ::pidfd_open(pid, 0);
  if (fd < 0) {
    const int why = errno;
    ::kill(pid, SIGKILL);  // nobody has waited for this child, so the number is still its own
    ::waitpid(pid, nullptr, 0);
    return refused(arguments.front() + ": cannot be watched: " + system_message(why));
  }
  return Process(pid, fd, true);
}

std::optional<Process> Process::adopt(pid_t pid, std::optional<std::uint64_t> start_ticks) {
  if (pid <= 0) return std::nullopt;
  const int fd = ::pidfd_open(pid, 0);
  if (fd < 0) return std::nullopt;
  Process process(pid, fd, false);
  if ((start_ticks && process.start_ticks() != *start_ticks) || process.has_ended())
    return std::nullopt;
  return process;
}

std::uint64_t Process::start_ticks() const {
  constexpr int kFieldsBetween = 19;  // number of fields between the name and field 22
  std::ifstream in("/proc/" + std::to_string(pid_) + "/stat");
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  std::size_t at = text.rfind(')');  // the name may have blanks and brackets
  if (at == std::string::npos || at + 2 > text.size()) return 0;
  at += 2;
  for (int i = 0; i < kFieldsBetween; ++i) {
    at = text.find(' ', at);
    if (at == std::string::npos) return 0;
    ++at;
  }
  std::uint64_t ticks = 0;
  std::from_chars(text.data() + at, text.data() + text.size(), ticks);
  return ticks;
}

bool Process::has_ended() {
  if (has_ended_) return true;
  pollfd ready{fd_.get(), POLLIN, 0};
  if (::poll(&ready, 1, 0) != 1) return false;
  has_ended_ = true;
  if (!is_child_) return true;
  siginfo_t info{};
  if (::waitid(P_PIDFD, static_cast<id_t>(fd_.get()), &info, WEXITED | WNOHANG) == 0) {
    if (info.si_code == CLD_EXITED)
      status_ = info.si_status;
    else
      signal_ = info.si_status;
  }
  return true;
}

std::string Process::end() const {
  if (signal_ != 0) return "signal " + std::to_string(signal_);
  return status_ >= 0 ? "exit code " + std::to_string(status_) : "";
}

std::optional<int> Process::exit_code() const {
  return status_ >= 0 ? std::optional(status_) : std::nullopt;
}

void Process::signal(int number) const noexcept {
  if (!has_ended_) ::pidfd_send_signal(fd_.get(), number, nullptr, 0);
}

Result<void> BriefRun::start(const std::vector<std::string>& words,
                             const std::filesystem::path& log) {
  if (const auto ok = Process::start(words, log).into(process_); !ok) return ok.error();
  stopped_at_.reset();
  has_ended_ = false;
  return {};
}

void BriefRun::stop(Clock::time_point now) {
  if (!is_running() || stopped_at_) return;
  stopped_at_ = now;
  process_->signal(SIGINT);
}

void BriefRun::poll(Clock::time_point now) {
  constexpr auto kKillAfter = std::chrono::seconds(1);
  if (!is_running()) return;
  if (stopped_at_ && now - *stopped_at_ > kKillAfter) process_->signal(SIGKILL);
  has_ended_ = process_->has_ended();
}

}  // namespace trocar::runtime
