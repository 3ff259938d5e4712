// SPDX-License-Identifier: Apache-2.0
// A thread that calls a function at a fixed rate on the monotonic clock. Realtime
// priority and locked memory are asked for, and what was granted is reported: without
// them the program runs on, with the latencies the report shows.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>

#include "runtime/loop/histogram.h"

namespace trocar::runtime {

struct RealtimeOptions {
  double rate_Hz = 1000;
  int priority = 80;                        ///< SCHED_FIFO, 1 to 99
  const std::atomic<bool>* stop = nullptr;  ///< ends the thread before its next call
};

struct RealtimeReport {
  bool fifo = false;           ///< SCHED_FIFO was granted
  bool memory_locked = false;  ///< mlockall was granted
  std::string note;            ///< what was not granted, and why; empty if all was
  /// Calls that ended after the next one's time. That time is then skipped, as often as needed:
  /// calls are never made up for in a burst.
  std::uint64_t missed_deadlines = 0;
  std::uint64_t page_faults = 0;  ///< of the thread, from the first call to the last
  Histogram wake;                 ///< how much later than asked for the thread woke
};

/// Calls `tick(gap_s)`, gap_s being the time since the call before (0 at first), until it returns
/// false or `stop` is set. Returns when the thread has ended.
RealtimeReport run_realtime(const RealtimeOptions& options,
                            const std::function<bool(double gap_s)>& tick);

}  // namespace trocar::runtime
