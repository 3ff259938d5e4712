// SPDX-License-Identifier: Apache-2.0
#include "runtime/realtime/realtime_thread.h"

#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <cerrno>
#include <cmath>
#include <fstream>

#include "formats/base/files.h"

namespace trocar::runtime {
namespace {

std::atomic<bool> hooked{false};
std::atomic<std::uint64_t> counted{0};
thread_local constinit bool in_realtime_scope = false;

constexpr std::int64_t kSecond_ns = 1'000'000'000;
constexpr std::size_t kStackTouched = std::size_t{256} << 10;

void sleep_until(std::int64_t time_ns) noexcept {
  const timespec until{time_ns / kSecond_ns, time_ns % kSecond_ns};
  while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
  }
}

/// Maps the pages of the stack that the loop will use. Called before the loop starts.
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

/// Returns the processors of a set in Linux's notation, such as "0-3,5".
std::string list_of(const cpu_set_t& set) {
  std::string list;
  for (int first = 0; first < CPU_SETSIZE; ++first) {
    if (!CPU_ISSET(first, &set)) continue;
    int last = first;
    while (last + 1 < CPU_SETSIZE && CPU_ISSET(last + 1, &set))
      ++last;
    if (!list.empty()) list += ',';
    list += std::to_string(first);
    if (last > first) list.append("-").append(std::to_string(last));
    first = last;
  }
  return list;
}

std::string scheduling_of_this_thread() {
  int policy = 0;
  sched_param parameters{};
  if (::pthread_getschedparam(::pthread_self(), &policy, &parameters) != 0) return "unknown";
  const char* name = policy == SCHED_FIFO    ? "SCHED_FIFO"
                     : policy == SCHED_RR    ? "SCHED_RR"
                     : policy == SCHED_OTHER ? "SCHED_OTHER"
                                             : "other";
  return std::string(name) + " " + std::to_string(parameters.sched_priority);
}

bool kernel_is_realtime() {
  std::ifstream file("/sys/kernel/realtime");
  int value = 0;
  return static_cast<bool>(file >> value) && value == 1;
}

void ask_for_cpu(const RealtimeOptions& options, RealtimeReport& report) {
  cpu_set_t set;
  CPU_ZERO(&set);
  if (options.cpu >= 0 && options.cpu < CPU_SETSIZE) {
    CPU_SET(options.cpu, &set);
    const int error = ::pthread_setaffinity_np(::pthread_self(), sizeof set, &set);
    if (error != 0) {
      add_note(report.note,
               "not on processor " + std::to_string(options.cpu) + ": " + system_message(error));
    }
  }
  if (::pthread_getaffinity_np(::pthread_self(), sizeof set, &set) == 0) report.cpus = list_of(set);
}

void ask_for_realtime(const RealtimeOptions& options, RealtimeReport& report) {
  // Future memory is locked only if locked memory is unlimited, because the first allocation beyond
  // a limit would fail.
  rlimit limit{};
  const bool unlimited =
      ::getrlimit(RLIMIT_MEMLOCK, &limit) == 0 && limit.rlim_cur == RLIM_INFINITY;
  report.memory_locked = ::mlockall(unlimited ? MCL_CURRENT | MCL_FUTURE : MCL_CURRENT) == 0;
  if (!report.memory_locked)
    add_note(report.note, "memory is not locked: " + system_message(errno));
  sched_param parameters{};
  parameters.sched_priority = options.priority;
  const int error = ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &parameters);
  report.fifo = error == 0;
  if (!report.fifo) add_note(report.note, "no realtime priority: " + system_message(error));
  if (::prctl(PR_SET_TIMERSLACK, 1UL) != 0)
    add_note(report.note, "no small timer slack: " + system_message(errno));
  report.timer_slack_ns = ::prctl(PR_GET_TIMERSLACK);
  ask_for_cpu(options, report);
  report.scheduling = scheduling_of_this_thread();
  report.kernel_is_realtime = kernel_is_realtime();
}

void run(const RealtimeOptions& options, const std::function<bool(const TickTiming&)>& tick,
         const std::function<void()>& at_end, RealtimeReport& report) {
  ask_for_realtime(options, report);
  touch_stack();
  const double period_ns = 1e9 / options.rate_Hz;
  const std::int64_t first_ns = monotonic_ns() + static_cast<std::int64_t>(period_ns);
  const auto time_of = [&](std::uint64_t call) {
    return first_ns + std::llround(period_ns * static_cast<double>(call));
  };
  const std::uint64_t faults_before = thread_page_faults();
  std::int64_t last_ns = 0;
  TickTiming timing;
  for (std::uint64_t call = 0; options.stop == nullptr || !options.stop->load();) {
    sleep_until(time_of(call));
    const std::int64_t woken_ns = monotonic_ns();
    timing.late_ns = woken_ns - time_of(call);
    report.wake.add(timing.late_ns);
    // Deadlines missed while the thread was asleep are counted before the call.
    for (; time_of(call + 1) <= woken_ns; ++call) {
      ++timing.missed_in_row;
      ++report.missed_deadlines;
    }
    report.missed_in_row_max = std::max(report.missed_in_row_max, timing.missed_in_row);
    timing.missed_deadlines = report.missed_deadlines;
    timing.gap_s = last_ns == 0 ? 0 : static_cast<double>(woken_ns - last_ns) * 1e-9;
    last_ns = woken_ns;
    if (!tick(timing)) break;
    const std::int64_t done_ns = monotonic_ns();
    ++call;
    if (done_ns <= time_of(call)) {
      timing.missed_in_row = 0;
      continue;
    }
    for (; time_of(call) < done_ns; ++call) {
      ++timing.missed_in_row;
      ++report.missed_deadlines;
    }
    report.missed_in_row_max = std::max(report.missed_in_row_max, timing.missed_in_row);
  }
  if (at_end) at_end();
  report.page_faults = thread_page_faults() - faults_before;
  if (report.memory_locked) ::munlockall();
}

}  // namespace

bool allocations_are_counted() noexcept {
  return hooked.load(std::memory_order_relaxed);
}
std::uint64_t allocations_in_scopes() noexcept {
  return counted.load(std::memory_order_relaxed);
}

NoAllocationScope::NoAllocationScope() noexcept {
  in_realtime_scope = true;
}
NoAllocationScope::~NoAllocationScope() {
  in_realtime_scope = false;
}

bool in_no_allocation_scope() noexcept {
  return in_realtime_scope;
}
void note_allocation() noexcept {
  if (in_realtime_scope) counted.fetch_add(1, std::memory_order_relaxed);
}
void announce_allocation_hooks() noexcept {
  hooked.store(true, std::memory_order_relaxed);
}

RealtimeReport run_realtime(const RealtimeOptions& options,
                            const std::function<bool(const TickTiming&)>& tick,
                            const std::function<void()>& at_end) {
  RealtimeReport report;
  std::thread thread([&] { run(options, tick, at_end, report); });
  thread.join();
  return report;
}

void request_priority(int priority) noexcept {
  sched_param parameters{};
  parameters.sched_priority = priority;
  static_cast<void>(::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &parameters));
  static_cast<void>(::prctl(PR_SET_TIMERSLACK, 1UL));
}

void keep_off(int cpu) {
  cpu_set_t set;
  if (cpu < 0 || cpu >= CPU_SETSIZE ||
      ::pthread_getaffinity_np(::pthread_self(), sizeof set, &set) != 0)
    return;
  CPU_CLR(cpu, &set);
  if (CPU_COUNT(&set) > 0) ::pthread_setaffinity_np(::pthread_self(), sizeof set, &set);
}

}  // namespace trocar::runtime
