// SPDX-License-Identifier: Apache-2.0
// A thread that calls a function at a fixed rate on the monotonic clock. It requests realtime
// priority, locked memory and optionally one processor, and reports which of these were granted.
// If a request is not granted, the thread still runs, but it may wake up later than requested.
// RealtimeReport shows how late the thread was.
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
  int cpu = -1;       ///< the only processor on which the thread may run; -1: any
  /// Optional flag that ends the thread. After it becomes true, at most one more call starts.
  const std::atomic<bool>* stop = nullptr;
};

struct RealtimeReport {
  bool fifo = false;                ///< SCHED_FIFO was granted
  bool memory_locked = false;       ///< mlockall was granted
  std::string scheduling;           ///< policy and priority, such as "SCHED_FIFO 80"
  std::string cpus;                 ///< processors that the thread may use, such as "0-3,5"
  bool kernel_is_realtime = false;  ///< the kernel is PREEMPT_RT: /sys/kernel/realtime holds 1
  /// Time in ns by which the kernel may delay a wake-up; -1: unknown. The thread requests 1 ns
  /// (Linux's default is 50000 ns). Threads with realtime priority have 0.
  int timer_slack_ns = -1;
  std::string note;  ///< requests that were not granted, with the reasons; empty: all were granted
  /// Number of deadlines at which no call started, because the previous call still ran or the
  /// thread had not woken up. Example: if a call takes between three and four periods, three
  /// deadlines are missed. The three calls are skipped and not made up for.
  std::uint64_t missed_deadlines = 0;
  int missed_in_row_max = 0;      ///< largest number of deadlines missed directly in a row
  std::uint64_t page_faults = 0;  ///< page faults of the thread, from the first call to the last
  Histogram wake;                 ///< durations from the requested to the actual wake-up
};

/// The timing of one call of `tick`.
struct TickTiming {
  double gap_s = 0;  ///< time from the previous call's start to this one; 0 in the first call
  /// Number of deadlines missed directly before this call. Three deadlines are missed if
  /// the previous call took between three and four periods, or if the thread woke up
  /// three periods late.
  int missed_in_row = 0;
  std::uint64_t missed_deadlines = 0;  ///< number of all deadlines missed so far
  std::int64_t late_ns = 0;            ///< time from the requested to the actual wake-up
};

/// Starts a thread that calls `tick` at the fixed rate, until `tick` returns false or
/// `options.stop` is true. The thread then calls `at_end`, if given, and ends. The function returns
/// when the thread has ended.
RealtimeReport run_realtime(const RealtimeOptions& options,
                            const std::function<bool(const TickTiming&)>& tick,
                            const std::function<void()>& at_end = {});

/// Requests realtime priority (SCHED_FIFO with `priority`, 1 to 99) and a timer slack of 1 ns for
/// the calling thread. If the system refuses a request, the function does not report that.
void request_priority(int priority) noexcept;

/// Forbids a processor to the calling thread and to all threads that it starts from then on. Does
/// nothing if `cpu` is -1, or if the calling thread may use no other processor. Call this for the
/// processor of a realtime thread, because a kernel that cannot be preempted would finish a system
/// call of another thread on that processor before the realtime thread could run.
void keep_off(int cpu);

}  // namespace trocar::runtime
