// SPDX-License-Identifier: Apache-2.0
// The interface between the haptic loop and its observers: the recorder, the black box, messages to
// the operator, the session publisher, the frame display, the tick feed, and the statistics. A new
// observer is one class derived from TickObserver, and one line in make_workers()
// (runtime/session/session_workers.cpp) or an entry in SessionOptions::observers.
#pragma once

#include <chrono>
#include <cstdint>
#include <span>

#include "runtime/control/haptic_loop.h"
#include "runtime/realtime/late_ticks.h"
#include "runtime/realtime/polling_thread.h"
#include "runtime/realtime/realtime_thread.h"

namespace trocar::runtime {

/// Returns true for the faults that the operator's commands pause and zero raise. These faults are
/// not failures: the session waits for the operator.
constexpr bool is_by_operator(Fault fault) noexcept {
  return fault == Fault::kPaused || fault == Fault::kForcesOff;
}

/// Returns true for the faults that are failures of the device or of the loop. A session that could
/// not be recorded ends as if the operator had stopped it.
constexpr bool is_failure(Fault fault) noexcept {
  return fault != Fault::kNone && fault != Fault::kRecordingFailed && !is_by_operator(fault);
}

struct PunctureEvent {
  std::int32_t sheet = -1;  ///< index of the sheet; the topmost is 0
  std::int32_t slice = -1;  ///< slice index in the asset
  std::uint32_t cut = 0;    ///< number of the hole in this sheet, counted from 1
  double t_s = 0;
  double tool_z_m = 0;       ///< height of the tip in {B}: RecordingRow::tool_m of the tick
  double penetration_m = 0;  ///< ContactOutput::penetration_m of the tick
  double tip_N = 0;          ///< RecordingRow::tip_N of the tick before the puncture
  double hand_N = 0;         ///< delivered force in the tick before the puncture
  /// Force that would have exceeded the tissue's threshold (law `cutting`: largest strength of the
  /// bone that the front passed), without the factor force_scale.
  double trial_force_N = 0;
};

/// A break-through (runtime/control/break_through.h).
struct BreakThroughEvent {
  std::int32_t sheet = -1;  ///< index of the sheet; -1: none
  std::int32_t at = -1;     ///< RecordingRow::break_through_at
  double t_s = 0;
  double tool_z_m = 0;
  double resistance_N = 0;  ///< RecordingRow::break_through_N
};

/// A message to the operator while a session runs.
struct OperatorMessage {
  enum class Kind : std::uint8_t {
    kFault,         ///< the fault `detail` was latched
    kNotRecovered,  ///< a requested recovery is delayed by the fault `detail`; if `detail` has no
                    ///< fault, the recovery is delayed because the tool is in material
    kRecovered,     ///< forces rise again; `detail.fault` is the fault that has ended
    kRefused,       ///< a request for recovery was refused, because the device's stop is held;
                    ///< `detail.fault` is kLinkLost if the device cannot tell its release
  };
  Kind kind = Kind::kFault;
  double t_s = 0;
  FaultDetail detail;
  double retract_distance_m = 0;  ///< kNotRecovered: distance by which the tool must be retracted
};

/// One tick, valid during the call of TickObserver::on_tick().
struct TickView {
  const TickResult& result;
  const LoopState& state;                ///< state after the tick
  std::span<const Sheet* const> sheets;  ///< meshes that the tick used, the topmost first
  const TickTiming& timing;              ///< all zero if is_real_time is false
  const LateTicks::Counts& late_ticks;   ///< deadlines missed before this tick, for each cause
  bool is_real_time = false;             ///< ticks follow the wall clock
  std::int64_t start_ns = 0;             ///< start of the tick on CLOCK_MONOTONIC
};

class TickObserver {
 public:
  /// In real time a background thread calls serve() and sleeps for `interval`, in turn. If the
  /// interval is 0, there is no such thread.
  explicit TickObserver(std::chrono::nanoseconds interval = {}) : interval_(interval) {}
  /// A derived class that overrides serve() must call stop() in its destructor.
  virtual ~TickObserver() = default;
  TickObserver(const TickObserver&) = delete;
  TickObserver& operator=(const TickObserver&) = delete;

  // The haptic thread calls these functions. They must not allocate, lock or make a system call.

  virtual void on_puncture(const PunctureEvent&) noexcept {}
  virtual void on_break_through(const BreakThroughEvent&) noexcept {}
  virtual void on_message(const OperatorMessage&) noexcept {}
  /// Called once a tick, after the punctures and messages of that tick.
  virtual void on_tick(const TickView& tick) noexcept = 0;

  // The thread that runs the session calls start() before the first tick, but only in real time,
  // and stop() after the last tick. In real time the thread that start() creates calls serve(). In
  // virtual time the thread that runs the session calls serve() after every tick.

  /// Processes the data that the haptic thread has queued.
  virtual void serve() {}
  void start() {
    if (interval_.count() > 0) thread_.start(interval_, [this] { serve(); });
  }
  /// Call this after the last tick. Ends the thread, if there is one, and calls serve() once more.
  virtual void stop() {
    join();
    serve();
  }

 protected:
  void join() { thread_.stop(); }

 private:
  std::chrono::nanoseconds interval_;
  PollingThread thread_;
};

}  // namespace trocar::runtime
