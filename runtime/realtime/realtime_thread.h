// SPDX-License-Identifier: Apache-2.0
// A thread that calls a function at a fixed rate on the monotonic clock. Realtime
// priority, locked memory and, if wanted, one processor are asked for, and what was granted is
// reported: without them the program runs on, with the latencies the report shows.
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
  int cpu = -1;                             ///< the processor to stay on; -1: any
  const std::atomic<bool>* stop = nullptr;  ///< ends the thread before its next call
};

struct RealtimeReport {
  bool fifo = false;                ///< SCHED_FIFO was granted
  bool memory_locked = false;       ///< mlockall was granted
  std::string scheduling;           ///< what the thread then had: class and priority
  std::string cpus;                 ///< processors it might run on, such as "0-3,5"
  bool kernel_is_realtime = false;  ///< /sys/kernel/realtime says so (PREEMPT_RT)
  std::string note;                 ///< what was not granted, and why; empty if all was
  /// Calls that ended after the next one's time. That time is then skipped, as often as needed:
  /// calls are never made up for in a burst.
  std::uint64_t missed_deadlines = 0;
  int missed_in_row_max = 0;      ///< TickTiming::missed_in_row, the largest
  std::uint64_t page_faults = 0;  ///< of the thread, from the first call to the last
  Histogram wake;                 ///< how much later than asked for the thread woke
};

/// What a call knows of the clock.
struct TickTiming {
  double gap_s = 0;       ///< since the start of the call before; 0 at first
  int missed_in_row = 0;  ///< times, right before this call's, at which one had not ended: a call
                          ///< that takes three periods misses three deadlines
};

/// Calls `tick` until it returns false or `stop` is set, then at once, on the same thread,
/// `at_end`, if there is one. Returns when the thread has ended.
RealtimeReport run_realtime(const RealtimeOptions& options,
                            const std::function<bool(const TickTiming&)>& tick,
                            const std::function<void()>& at_end = {});

}  // namespace trocar::runtime
