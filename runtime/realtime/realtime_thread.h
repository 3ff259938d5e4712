// SPDX-License-Identifier: Apache-2.0
// Realtime threads: clock, missed deadlines, allocations, and background threads.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <ctime>
#include <functional>
#include <stop_token>
#include <string>
#include <thread>
#include <utility>

#include "runtime/realtime/histogram.h"

namespace trocar::runtime {

// Reads the system's monotonic clock in nanoseconds.

/// Returns the time of CLOCK_MONOTONIC in ns. On most Linux kernels this needs no system call.
inline std::int64_t monotonic_ns() noexcept {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * std::int64_t{1'000'000'000} + now.tv_nsec;
}

// A thread that calls a function at a fixed rate on the monotonic clock. It requests realtime
// priority, locked memory and optionally one processor, and reports which of these were granted.
// If a request is not granted, the thread still runs, but it may wake up later than requested.
// RealtimeReport shows how late the thread was.

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

// Counts missed deadlines by their cause, that is, by the part of a tick that took too long.

/// The parts of a tick: the thread wakes up, the device is read and written, the force law computes
/// the force, and the tick is published to its observers.
enum class TickPart : std::uint8_t { kWaking, kDevice, kLaw, kPublishing };
inline constexpr std::size_t kTickParts = 4;
inline constexpr std::array<const char*, kTickParts> kTickPartNames = {"waking", "device", "law",
                                                                       "publishing"};

/// The haptic thread calls these functions. They neither allocate nor throw.
class LateTicks {
 public:
  using Counts = std::array<std::uint64_t, kTickParts>;

  /// Call this when a tick begins. Deadlines that passed between the requested and the actual
  /// wake-up of the thread count for kWaking. All other deadlines missed since the last call of
  /// begin() passed during the previous tick. They count for the part on which the previous tick
  /// spent the longest time, according to the calls of spend().
  void begin(const TickTiming& timing, double period_ns) noexcept {
    const std::uint64_t missed = timing.missed_deadlines - missed_;
    missed_ = timing.missed_deadlines;
    const auto asleep =
        static_cast<std::uint64_t>(std::max(0.0, static_cast<double>(timing.late_ns) / period_ns));
    const std::uint64_t by_waking = std::min(missed, asleep);
    counts_[static_cast<std::size_t>(TickPart::kWaking)] += by_waking;
    const auto longest = std::max_element(spent_ns_.begin() + 1, spent_ns_.end());
    counts_[static_cast<std::size_t>(longest - spent_ns_.begin())] += missed - by_waking;
    spent_ns_.fill(0);
  }
  /// Call this after a part of the tick. Adds to the time that the tick has spent on this part.
  void spend(TickPart part, std::int64_t duration_ns) noexcept {
    spent_ns_[static_cast<std::size_t>(part)] += duration_ns;
  }
  /// Number of missed deadlines for each part. The numbers add up to the `missed_deadlines` that
  /// the last call of begin() received.
  const Counts& counts() const noexcept { return counts_; }

 private:
  Counts counts_{};
  std::array<std::int64_t, kTickParts> spent_ns_{};
  std::uint64_t missed_ = 0;
};

// Counts the allocations of realtime code, so that tests can demand that there are none. If the
// calling thread is inside a NoAllocationScope, calls of malloc, calloc, realloc, aligned_alloc,
// posix_memalign and free are counted. Calls of new and delete are counted too, because they use
// these functions.
//
// Only programs that link the target trocar_allocation_hooks (tests/reference/hooks) count
// allocations. In the shipped programs and in sanitizer builds nothing is counted. There, a scope
// costs almost no time: it writes a thread-local variable at its beginning and at its end.

/// Returns true if this program counts allocations.
bool allocations_are_counted() noexcept;
/// Returns the number of allocations inside scopes, of all threads together, since the program
/// started. Returns 0 if this program does not count allocations.
std::uint64_t allocations_in_scopes() noexcept;

/// While a scope exists, the allocations of the thread that created the scope are counted. A thread
/// must not create a scope inside another scope.
class NoAllocationScope {
 public:
  NoAllocationScope() noexcept;
  ~NoAllocationScope();
  NoAllocationScope(const NoAllocationScope&) = delete;
  NoAllocationScope& operator=(const NoAllocationScope&) = delete;
};

// Only the hooks in tests/reference/hooks call the following functions.

/// Returns true if the calling thread is inside a scope.
bool in_no_allocation_scope() noexcept;
/// Counts one allocation by the calling thread if it is inside a scope.
void note_allocation() noexcept;
/// The allocation hooks call this once. Afterwards allocations_are_counted() returns true.
void announce_allocation_hooks() noexcept;

// A background thread that calls a function again and again, and sleeps for a fixed interval after
// each call. The function checks whether the haptic thread has left work to do. The haptic thread
// does not wake the background thread, because that would need a system call.

class PollingThread {
 public:
  /// Starts the thread. Until stop(), the thread calls `serve` and sleeps for `interval`, in turn.
  void start(std::chrono::nanoseconds interval, std::function<void()> serve) {
    thread_ = std::jthread([interval, serve = std::move(serve)](const std::stop_token& stop) {
      while (!stop.stop_requested()) {
        serve();
        std::this_thread::sleep_for(interval);
      }
    });
  }
  /// Ends the thread and waits until it has ended. Does nothing if the thread was not started. Work
  /// that arrived after the last call of `serve` is not done; the caller can do it after stop().
  void stop() { thread_ = {}; }

 private:
  std::jthread thread_;
};

}  // namespace trocar::runtime
