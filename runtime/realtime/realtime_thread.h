// SPDX-License-Identifier: Apache-2.0
// A thread that calls a function at a fixed rate on the monotonic clock. It requests realtime
// priority, locked memory and optionally one processor, and reports what was granted. Without them
// the program runs on, with the latencies that the report shows.
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
  int cpu = -1;                             ///< the processor to run on, see keep_off(); -1: any
  const std::atomic<bool>* stop = nullptr;  ///< ends the thread before its next call
};

struct RealtimeReport {
  bool fifo = false;                ///< SCHED_FIFO was granted
  bool memory_locked = false;       ///< mlockall was granted
  std::string scheduling;           ///< the thread's class and priority
  std::string cpus;                 ///< processors it may run on, such as "0-3,5"
  bool kernel_is_realtime = false;  ///< /sys/kernel/realtime says so (PREEMPT_RT)
  /// By how much the kernel may delay a wake-up, ns: 1 is asked for (Linux's default is 50000), and
  /// realtime threads have 0. -1: unknown.
  int timer_slack_ns = -1;
  std::string note;  ///< what was not granted, and why; else empty
  /// Times at which a call should have started while another still ran, or while the thread had not
  /// woken up: a call that takes three periods misses three. They are skipped: there are no bursts
  /// of calls to catch up.
  std::uint64_t missed_deadlines = 0;
  int missed_in_row_max = 0;      ///< TickTiming::missed_in_row, the largest; <= missed_deadlines
  std::uint64_t page_faults = 0;  ///< of the thread, from the first call to the last
  Histogram wake;                 ///< wake-up time less the requested time
};

/// Timing of a call.
struct TickTiming {
  double gap_s = 0;       ///< since the previous call started; 0 in the first
  int missed_in_row = 0;  ///< deadlines missed directly before this call: a call that takes three
                          ///< periods misses three, as does one that wakes up three periods late
  std::uint64_t missed_deadlines = 0;  ///< so far
  std::int64_t late_ns = 0;            ///< wake-up time less the requested time
};

/// Calls `tick` until it returns false or `stop` is set, then immediately, on the same thread,
/// `at_end` if there is one. Returns when the thread has ended.
RealtimeReport run_realtime(const RealtimeOptions& options,
                            const std::function<bool(const TickTiming&)>& tick,
                            const std::function<void()>& at_end = {});

/// Takes a processor from the calling thread, and so from those that it starts from then on, unless
/// it has no other; none for -1. A kernel that does not preempt itself would let their system calls
/// hold up a realtime thread on that processor.
void keep_off(int cpu);

}  // namespace trocar::runtime
