// SPDX-License-Identifier: Apache-2.0
// A clock decides when the ticks of a session happen, and from which tick on new meshes and
// prefetched stiffness are used. There are three clocks:
//  - real: ticks follow the wall clock. Meshes and stiffness are used as soon as they are ready.
//  - virtual: ticks follow each other without a pause. Meshes and stiffness are used a fixed number
//    of ticks after their request, so that the same input gives the same recording.
//  - replay: ticks follow each other without a pause. A new mesh is used from the same tick on as
//    in the recording (column `cuts_published`). The stiffness of each tick is read from the
//    recording (columns `response_*`). The recording also supplies requests for recovery, requests
//    for X-ray pictures, and faults from outside the loop, such as the operator's emergency stop.
#pragma once

#include <cstdint>
#include <memory>

#include "formats/session/recording.h"
#include "runtime/haptics/force_law.h"
#include "runtime/haptics/puncture.h"
#include "runtime/realtime/realtime_thread.h"
#include "runtime/session/remesher.h"
#include "runtime/session/session_options.h"

namespace trocar::runtime {

class SessionLoop;

class SessionClock {
 public:
  virtual ~SessionClock() = default;

  /// Number of ticks of the whole session.
  std::uint64_t ticks() const noexcept { return ticks_; }

  // The haptic thread calls these functions during a tick.

  /// Returns the recorded row of a tick; null if the session is not a replay.
  virtual const RecordingRow* recorded(std::uint64_t) const noexcept { return nullptr; }
  /// Returns the prefetched stiffness to use in this tick.
  virtual const PrefetchedStiffness& stiffness() noexcept { return stiffness_; }
  /// Called once in each tick with the tick's request for stiffness. The real clock passes the
  /// request to the prefetch worker; the other clocks ignore this call.
  virtual void prefetch(const PrefetchRequest&) noexcept {}

  /// Runs the session to its end, and stops the remesher. Zero torques are written directly after
  /// the last tick; otherwise the motors would hold the last torques while the other threads end.
  virtual RealtimeReport run(SessionLoop& loop) = 0;

 protected:
  explicit SessionClock(std::uint64_t ticks) : ticks_(ticks) {}
  PrefetchedStiffness stiffness_;

 private:
  std::uint64_t ticks_;
};

/// Returns the clock that `options` ask for: a replay clock if there is a recording to replay,
/// otherwise the clock of SessionOptions::clock. `prefetch`: the worker that computes prefetched
/// stiffness; null if the force law has none. The arguments must outlive the clock.
std::unique_ptr<SessionClock> make_clock(const SessionOptions& options, Remesher& remesher,
                                         PrefetchWorker* prefetch);

}  // namespace trocar::runtime
