// SPDX-License-Identifier: Apache-2.0
// A clock decides when the ticks of a session happen, and from which tick on new meshes and
// prefetched stiffness are used. There are three clocks:
//  - real: ticks follow the wall clock. Meshes and stiffness are used as soon as they are ready.
//  - virtual: ticks follow each other without a pause. Meshes and stiffness are used a fixed number
//    of ticks after their request, so that the same input gives the same recording.
//  - replay: like virtual, but each mesh and each stiffness comes into use in the tick in which it
//    did so in the recording (columns `cuts_published` and `response_*`). Requests for recovery,
//    requests for X-ray pictures and faults from outside the loop also come from the recording.
// Tests: tests/runtime/session/session_test.cpp
#pragma once

#include <cstdint>
#include <memory>

#include "formats/session/recording.h"
#include "runtime/contact/prefetch_worker.h"
#include "runtime/contact/puncture.h"
#include "runtime/realtime/realtime_thread.h"
#include "runtime/session/session_options.h"
#include "runtime/workers/remesher.h"

namespace trocar::runtime {

class SessionLoop;

class SessionClock {
 public:
  virtual ~SessionClock() = default;

  /// Number of ticks of the whole session.
  std::uint64_t ticks() const noexcept { return ticks_; }
  virtual bool is_real_time() const noexcept { return false; }

  // The haptic thread calls these functions during a tick.

  /// Returns the recorded row of this tick; null: the session is not a replay.
  virtual const RecordingRow* recorded(std::uint64_t) const noexcept { return nullptr; }
  /// Returns the prefetched stiffness to use in this tick.
  virtual const PrefetchedStiffness& stiffness() noexcept { return stiffness_; }
  /// Called at the end of a tick with its request. Only the real clock passes the request to the
  /// prefetch worker here.
  virtual void prefetch(const PrefetchRequest&) noexcept {}

  /// Runs the session to its end, and stops the remesher. The torques are set to zero directly
  /// after the last tick; otherwise the motors would hold the last torques while the other threads
  /// end.
  virtual RealtimeReport run(SessionLoop& loop) = 0;

 protected:
  explicit SessionClock(std::uint64_t ticks) : ticks_(ticks) {}
  PrefetchedStiffness stiffness_;

 private:
  std::uint64_t ticks_;
};

/// Returns the clock for these options. `prefetch`: the worker of the force law; may be null. The
/// arguments must outlive the clock.
std::unique_ptr<SessionClock> make_clock(const SessionOptions& options, Remesher& remesher,
                                         PrefetchWorker* prefetch);

}  // namespace trocar::runtime
