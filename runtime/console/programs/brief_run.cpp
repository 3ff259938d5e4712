// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/programs/brief_run.h"

#include <csignal>
#include <utility>

namespace trocar::runtime {

Result<void> BriefRun::start(const std::vector<std::string>& words,
                             const std::filesystem::path& log) {
  Result<Process> process = Process::start(words, log);
  if (!process) return process.error();
  process_ = std::move(*process);
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

std::optional<int> BriefRun::exit_code() const {
  return has_ended_ ? process_->exit_code() : std::nullopt;
}

}  // namespace trocar::runtime
