// SPDX-License-Identifier: Apache-2.0
// A thread that calls a function at a fixed rate on the monotonic clock. It requests realtime
// priority, locked memory and optionally one processor, and reports which of these were granted.
// Without them the program runs on, with the latencies that the report shows.
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
  int priority = 80;                        ///< SCHED_FIFO, 1 to 99
  int cpu = -1;                             ///< the processor to use, see keep_off(); -1 for any
  const std::atomic<bool>* stop = nullptr;  ///< ends the thread before its next call
};

struct RealtimeReport {
  bool fifo = false;                ///< SCHED_FIFO was granted
  bool memory_locked = false;       ///< mlockall was granted
  std::string scheduling;           ///< the thread's class and priority
  std::string cpus;                 ///< processors it may run on, such as "0-3,5"
  bool kernel_is_realtime = false;  ///< /sys/kernel/realtime says so (PREEMPT_RT)
  /// The time in ns by which the kernel may delay a wake-up; -1 if unknown. 1 is requested (Linux's
  /// default is 50000); realtime threads have 0.
  int timer_slack_ns = -1;
  std::string note;  ///< the requests that were not granted, with the reasons; else empty
  /// Times at which a call should have started while another still ran, or while the thread had not
  /// woken up: a call that takes three periods misses three. Missed calls are skipped, without
  /// bursts of calls to catch up.
  std::uint64_t missed_deadlines = 0;
  int missed_in_row_max = 0;      ///< largest TickTiming::missed_in_row; <= missed_deadlines
  std::uint64_t page_faults = 0;  ///< page faults of the thread, from the first call to the last
  Histogram wake;                 ///< wake-up time minus the requested time
};

/// Timing of a call.
struct TickTiming {
  double gap_s = 0;  ///< time since the previous call started; 0 in the first call
  /// Deadlines missed directly before this call. A call that takes three periods misses three, as
  /// does one that wakes up three periods late.
  int missed_in_row = 0;
  std::uint64_t missed_deadlines = 0;  ///< all deadlines missed so far
  std::int64_t late_ns = 0;            ///< wake-up time minus the requested time
};

/// Calls `tick` at the fixed rate until it returns false or `stop` is set. Immediately afterwards
/// it calls `at_end`, if given, on the same thread. Returns when the thread has ended.
RealtimeReport run_realtime(const RealtimeOptions& options,
                            const std::function<bool(const TickTiming&)>& tick,
                            const std::function<void()>& at_end = {});

/// Excludes the calling thread, and all threads that it starts from then on, from a processor,
/// unless it has no other; does nothing for -1. Otherwise, on a kernel that does not preempt
/// itself, their system calls would delay a realtime thread on that processor.
void keep_off(int cpu);

}  // namespace trocar::runtime
