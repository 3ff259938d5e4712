// SPDX-License-Identifier: Apache-2.0
#include "runtime/loop/realtime_thread.h"

#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>

#include <array>
#include <cerrno>
#include <cmath>
#include <ctime>
#include <system_error>
#include <thread>

namespace trocar::runtime {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;
constexpr std::size_t kStackTouched = std::size_t{256} << 10;

std::string why(int error) {
  return std::generic_category().message(error);
}

std::int64_t now_ns() noexcept {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * kSecond_ns + now.tv_nsec;
}

void sleep_until(std::int64_t time_ns) noexcept {
  const timespec until{time_ns / kSecond_ns, time_ns % kSecond_ns};
  while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
  }
}

/// Pages of the stack that the loop will use are there before it starts.
__attribute__((noinline)) void touch_stack() noexcept {
  std::array<volatile unsigned char, kStackTouched> pages;
  for (std::size_t i = 0; i < kStackTouched; i += 4096)
    pages[i] = 0;
}

std::uint64_t thread_page_faults() noexcept {
  rusage usage{};
  ::getrusage(RUSAGE_THREAD, &usage);
  return static_cast<std::uint64_t>(usage.ru_minflt) + static_cast<std::uint64_t>(usage.ru_majflt);
}

void add_note(std::string& note, const std::string& what) {
  note += (note.empty() ? "" : "; ") + what;
}

void ask_for_realtime(const RealtimeOptions& options, RealtimeReport& report) {
  // Memory of the future is locked only where there is no limit to it: with one, the
  // first allocation beyond it would fail.
  rlimit limit{};
  const bool unlimited =
      ::getrlimit(RLIMIT_MEMLOCK, &limit) == 0 && limit.rlim_cur == RLIM_INFINITY;
  report.memory_locked = ::mlockall(unlimited ? MCL_CURRENT | MCL_FUTURE : MCL_CURRENT) == 0;
  if (!report.memory_locked) add_note(report.note, "memory is not locked: " + why(errno));
  sched_param parameters{};
  parameters.sched_priority = options.priority;
  const int error = ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &parameters);
  report.fifo = error == 0;
  if (!report.fifo) add_note(report.note, "no realtime priority: " + why(error));
}

void run(const RealtimeOptions& options, const std::function<bool(double)>& tick,
         RealtimeReport& report) {
  ask_for_realtime(options, report);
  touch_stack();
  const double period_ns = 1e9 / options.rate_Hz;
  const std::int64_t first_ns = now_ns() + static_cast<std::int64_t>(period_ns);
  const auto time_of = [&](std::uint64_t call) {
    return first_ns + std::llround(period_ns * static_cast<double>(call));
  };
  const std::uint64_t faults_before = thread_page_faults();
  std::int64_t last_ns = 0;
  for (std::uint64_t call = 0; options.stop == nullptr || !options.stop->load();) {
    sleep_until(time_of(call));
    const std::int64_t woken_ns = now_ns();
    report.wake.add(woken_ns - time_of(call));
    const double gap_s = last_ns == 0 ? 0 : static_cast<double>(woken_ns - last_ns) * 1e-9;
    last_ns = woken_ns;
    if (!tick(gap_s)) break;
    const std::int64_t done_ns = now_ns();
    ++call;
    if (done_ns > time_of(call)) {
      ++report.missed_deadlines;
      while (time_of(call) < done_ns)
        ++call;
    }
  }
  report.page_faults = thread_page_faults() - faults_before;
  if (report.memory_locked) ::munlockall();
}

}  // namespace

RealtimeReport run_realtime(const RealtimeOptions& options,
                            const std::function<bool(double)>& tick) {
  RealtimeReport report;
  std::thread thread([&] { run(options, tick, report); });
  thread.join();
  return report;
}

}  // namespace trocar::runtime
