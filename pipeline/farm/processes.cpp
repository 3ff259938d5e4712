// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/farm/processes.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdio>

#include "formats/base/system_message.h"
#include "pipeline/farm/atomic_file.h"

namespace trocar::farm {

pid_t fork_with_signal(int signal) {
  const pid_t parent = ::getpid();
  const pid_t pid = ::fork();
  if (pid != 0) return pid;
  ::prctl(PR_SET_PDEATHSIG, signal);
  if (::getppid() != parent) ::_exit(1);  // the parent died before prctl()
  return 0;
}

Processes::~Processes() {
  signal_all(SIGKILL);
  for (const Running& one : running_) {
    ::close(one.fd);
    ::waitpid(one.pid, nullptr, 0);
  }
}

Result<void> Processes::start(std::size_t task, const std::function<std::string()>& work) {
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0)
    return bug("cannot create a pipe for a scan's process: " + system_message(errno));
  std::fflush(nullptr);
  const pid_t pid = fork_with_signal(SIGKILL);
  if (pid < 0) {
    const int error = errno;
    ::close(ends[0]);
    ::close(ends[1]);
    return bug("cannot create a process for a scan: " + system_message(error));
  }
  if (pid == 0) {
    ::close(ends[0]);
    for (const Running& other : running_)
      ::close(other.fd);
    write_all(ends[1], work());
    std::fflush(nullptr);
    ::_exit(0);  // without the destructors of the parent's objects
  }
  ::close(ends[1]);
  running_.push_back({task, pid, ends[0], {}, std::chrono::steady_clock::now()});
  return {};
}

std::optional<Ended> Processes::wait(std::chrono::milliseconds most) {
  std::vector<pollfd> waiting;
  for (const Running& one : running_)
    waiting.push_back({one.fd, POLLIN, 0});
  if (::poll(waiting.data(), waiting.size(), static_cast<int>(most.count())) <= 0)
    return std::nullopt;
  for (std::size_t k = 0; k < waiting.size(); ++k) {
    if (waiting[k].revents == 0) continue;
    std::array<char, 4096> block{};
    const ssize_t got = ::read(running_[k].fd, block.data(), block.size());
    if (got > 0) running_[k].text.append(block.data(), static_cast<std::size_t>(got));
    if (got > 0 || (got < 0 && errno == EINTR)) continue;
    const Running one = std::move(running_[k]);
    running_.erase(running_.begin() + static_cast<std::ptrdiff_t>(k));
    ::close(one.fd);
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

}  // namespace trocar::farm
