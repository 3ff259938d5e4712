// SPDX-License-Identifier: Apache-2.0
// A thread that calls a function at a fixed rate on the monotonic clock. It requests realtime
// priority, locked memory and optionally one processor, and reports which of these were granted.
// Without them the program still runs, with the latencies that the report shows.
// Tests: tests/runtime/realtime/handover_test.cpp
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>

#include "runtime/realtime/histogram.h"

namespace trocar::runtime {

struct RealtimeOptions {
  double rate_Hz = 1000;
  int priority = 80;  ///< priority of SCHED_FIFO, 1 to 99
  int cpu = -1;       ///< processor to use, see keep_off(); -1: any
  /// If set to true, the thread ends before its next call.
  const std::atomic<bool>* stop = nullptr;
};

struct RealtimeReport {
  bool fifo = false;                ///< SCHED_FIFO was granted
  bool memory_locked = false;       ///< mlockall was granted
  std::string scheduling;           ///< the thread's class and priority
  std::string cpus;                 ///< processors that the thread may use, such as "0-3,5"
  bool kernel_is_realtime = false;  ///< /sys/kernel/realtime says so (PREEMPT_RT)
  /// Time in ns by which the kernel may delay a wake-up; -1: unknown. The thread requests 1 ns
  /// (Linux's default is 50000 ns). Threads with realtime priority have 0.
  int timer_slack_ns = -1;
  std::string note;  ///< requests that were not granted, with the reasons; empty if all were
  /// Number of times at which a call should have started, but another call still ran or the thread
  /// had not woken up. For example, a call that takes between three and four periods misses three
  /// deadlines. Missed calls are skipped: the thread does not catch up by a burst of calls.
  std::uint64_t missed_deadlines = 0;
  int missed_in_row_max = 0;      ///< largest TickTiming::missed_in_row; <= missed_deadlines
  std::uint64_t page_faults = 0;  ///< page faults of the thread, from the first call to the last
  Histogram wake;                 ///< wake-up time minus the requested time
};

/// Timing of one call.
struct TickTiming {
  double gap_s = 0;  ///< time since the previous call started; 0 in the first call
  /// Number of deadlines missed directly before this call. Three deadlines are missed if
  /// the previous call took between three and four periods, or if the thread woke up
  /// three periods late.
  int missed_in_row = 0;
  std::uint64_t missed_deadlines = 0;  ///< all deadlines missed so far
  std::int64_t late_ns = 0;            ///< wake-up time minus the requested time
};

/// Calls `tick` at the fixed rate on a new thread, until it returns false or `stop` is set.
/// Immediately afterwards calls `at_end`, if given, on the same thread. Returns when the
/// thread has ended.
RealtimeReport run_realtime(const RealtimeOptions& options,
                            const std::function<bool(const TickTiming&)>& tick,
                            const std::function<void()>& at_end = {});

/// Requests realtime priority (SCHED_FIFO with `priority`, 1 to 99) and exact timers for the
/// calling thread. If the system does not grant a request, the function ignores this.
void request_priority(int priority) noexcept;

/// Keeps the calling thread, and all threads that it starts from then on, off a processor. Does
/// nothing if `cpu` is -1, or if the calling thread may use no other processor. This is needed
/// because, on a kernel that does not preempt itself, system calls of these threads would delay a
/// realtime thread on that processor.
void keep_off(int cpu);

}  // namespace trocar::runtime
