// SPDX-License-Identifier: Apache-2.0
#include "runtime/program/suspending_signals.h"

#include <unistd.h>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <thread>
#include <utility>

#include "formats/base/command_line.h"
#include "runtime/realtime/realtime_thread.h"

namespace trocar::runtime {
namespace {

constexpr int kStopping[] = {SIGTSTP, SIGTTIN, SIGTTOU};
constexpr int kEnding[] = {SIGQUIT, SIGXCPU,   SIGALRM, SIGUSR2, SIGVTALRM,
                           SIGPROF, SIGSTKFLT, SIGIO,   SIGPWR};
constexpr auto kPoll = std::chrono::milliseconds(2);
/// Periods in which zero force was written before the process may stop: a connection of another
/// maker sends a command one or two periods after it was written.
constexpr std::uint64_t kZeroPeriods = 4;
/// A loop that does not pause within this time does not run (any more).
constexpr auto kPatience = std::chrono::seconds(1);

Suspension the_suspension;

void handle(int signal, void (*handler)(int)) {
  struct sigaction action {};
  action.sa_handler = handler;
  // Writing to a terminal that is not the process's own raises SIGTTOU: the write then fails.
  action.sa_flags = signal == SIGTTOU ? 0 : SA_RESTART;
  ::sigaction(signal, &action, nullptr);
}

}  // namespace

Suspension& SuspendingSignals::suspension() noexcept {
  return the_suspension;
}

SuspendingSignals::SuspendingSignals(int loop_cpu) : avoided_cpu_(loop_cpu) {
  for (const int signal : kStopping)
    handle(signal, [](int) { the_suspension.is_requested.store(true); });
  for (const int signal : kEnding)
    handle(signal, [](int) { stop_requested.store(true); });
  thread_.start(kPoll, [this] { serve(); });
}

SuspendingSignals::~SuspendingSignals() {
  for (const int signal : kStopping)
    handle(signal, SIG_DFL);
  thread_.stop();
}

void SuspendingSignals::serve() {
  keep_off(std::exchange(avoided_cpu_, -1));
  if (!the_suspension.is_requested.load()) return;
  const std::uint64_t wanted = the_suspension.paused_periods.load() + kZeroPeriods;
  const auto until = std::chrono::steady_clock::now() + kPatience;
  while (the_suspension.paused_periods.load() < wanted && std::chrono::steady_clock::now() < until)
    std::this_thread::sleep_for(kPoll);
  ::kill(::getpid(), SIGSTOP);
  the_suspension.is_requested.store(false);  // the loop has latched the pause
  std::fprintf(stderr,
               "trocar-run: the session was stopped, and is paused: resume it on its page, or let "
               "forces return with kill -USR1 %d\n",
               static_cast<int>(::getpid()));
}

}  // namespace trocar::runtime
