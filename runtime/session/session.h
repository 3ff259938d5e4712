// SPDX-License-Identifier: Apache-2.0
// A session: its clock, its workers, its loop, and its run.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/device/hand_device.h"
#include "runtime/haptics/force_law.h"
#include "runtime/haptics/loop/haptic_loop.h"
#include "runtime/haptics/puncture.h"
#include "runtime/realtime/realtime_thread.h"
#include "runtime/session/operator_messages.h"
#include "runtime/session/recorder.h"
#include "runtime/session/remesher.h"
#include "runtime/session/session_options.h"
#include "runtime/session/session_publisher.h"
#include "runtime/session/session_statistics.h"

namespace trocar::runtime {

// A clock decides when the ticks of a session happen, and from which tick on new meshes and
// prefetched stiffness are used. There are three clocks:
//  - real: ticks follow the wall clock. Meshes and stiffness are used as soon as they are ready.
//  - virtual: ticks follow each other without a pause. Meshes and stiffness are used a fixed number
//    of ticks after their request, so that the same input gives the same recording.
//  - replay: ticks follow each other without a pause. A new mesh is used from the same tick on as
//    in the recording (column `cuts_published`). The stiffness of each tick is read from the
//    recording (columns `response_*`). The recording also supplies requests for recovery, requests
//    for X-ray pictures, and faults from outside the loop, such as the operator's emergency stop.

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

// The observers and workers of a session. The program creates them before it opens the link to a
// drive (the electronics of a device). The reason is that a drive waits only a short time for the
// first tick, and creating the workers takes longer.

/// The comment of each observer names an option. If this option is not set, the observer is null.
/// Members are destroyed in reverse order: the force law last, because the observers use its prefetch
/// worker, and the recorder after the publisher, which reads it.
struct SessionWorkers {
  std::shared_ptr<ForceLaw> law;                ///< never null
  PoseEstimator estimator;                      ///< the law's, or that of the recording in a replay
  std::unique_ptr<Recorder> recorder;           ///< SessionOptions::record
  std::unique_ptr<BlackBox> black_box;          ///< SessionOptions::black_box
  std::unique_ptr<OperatorMessages> messages;   ///< SessionOptions::on_message
  std::unique_ptr<FrameDisplay> frames;         ///< SessionOptions::on_frame
  std::unique_ptr<SessionPublisher> publisher;  ///< SessionOptions::telemetry
  std::unique_ptr<TickFeed> tick_feed;          ///< SessionOptions::on_tick

  /// Returns the observers that are not null, in the order in which the session calls them.
  std::vector<TickObserver*> observers() const;
};

/// Creates the workers and observers. Errors: kUnwritable if the recording, the folder of the black
/// boxes or the telemetry cannot be written; kRefused if the force law refuses the scene. Later
/// failures, during the session, are reported in SessionResult.
Result<SessionWorkers> make_workers(const Scene& scene, const DeviceSpecification& device,
                                    const Remesher& remesher, const SessionOptions& options);

// The session loop, which runs the ticks of a session one by one. haptic_tick()
// (runtime/haptics/loop/haptic_loop.h) computes a tick. The loop supplies the inputs of this function:
// the operator's commands, the current meshes and the prefetched stiffness. The loop passes
// requests for holes to the remesher, and passes the result of the tick to the observers.

class SessionLoop {
 public:
  /// All arguments must outlive the loop. The loop calls `advance(dt_s)` at the end of each tick
  /// with the duration of a tick; a simulated device then advances its time.
  SessionLoop(const Scene& scene, Remesher& remesher, HandDevice& device,
              const std::function<void(double dt_s)>& advance, const SessionOptions& options,
              const SessionWorkers& workers, SessionClock& clock);

  // The haptic thread calls these functions.

  /// Runs one tick. Returns false if the session is over. While the session is paused, no tick is
  /// counted. The call then only takes the operator's commands and the live hand's message, and
  /// updates the telemetry. A device with a clock of its own needs commands even during a pause, so
  /// the call also writes zero torques to such a device.
  bool tick(const TickTiming& timing) noexcept;
  void write_zero_torques() noexcept { device_.write_zero(); }

  // In virtual time, the thread that calls tick() may call these functions between two ticks.

  std::uint64_t ticks_done() const noexcept { return state_.tick; }
  bool is_paused() const noexcept { return is_paused_; }
  const ContactOutput& contact() const noexcept { return result_.contact; }

  // The remesher's thread calls this function; in virtual time, the thread that calls tick() does.

  /// If the session has shared memory that other processes read, copies new meshes to it.
  void publish_sheets();

  // The thread that runs the session calls these functions.

  /// Starts the observers' threads. Call this before the first tick in real time.
  void start_observers();
  /// Calls TickObserver::serve() of each observer, which processes what the tick has queued. Call
  /// this after each tick in virtual time.
  void serve_observers();
  /// Stops the observers and returns the result. Call this after the last tick.
  SessionResult finish();

 private:
  void receive_hand(std::int64_t now_ns) noexcept;
  std::uint8_t xray_of_tick() noexcept;
  bool pauses(std::int64_t now_ns) noexcept;
  TickInputs inputs(const TickTiming& timing) noexcept;
  void request_hole(const CutRequest& cut) noexcept;
  bool goes_on() const noexcept;
  bool recording_has_failed() const noexcept;

  LoopModel model_;
  LoopState state_;
  TickResult result_;
  double last_hand_N_ = 0;  ///< magnitude of the delivered force in the previous tick
  Remesher& remesher_;
  HandDevice& device_;
  ForceLaw& law_;
  const std::function<void(double)>& advance_;
  const SessionOptions& options_;
  SessionClock& clock_;
  const Recorder* recorder_;     ///< null: no recording
  SessionPublisher* publisher_;  ///< source of the operator's commands; null: no such source
  OperatorCommands commands_;
  XrayCommands xray_;
  TelemetryHand hand_;  ///< latest complete message of a hand that a person moves
  MessageSource messages_;
  SessionStatistics statistics_;
  LateTicks late_ticks_;
  std::vector<TickObserver*> observers_;
  std::vector<const Sheet*> sheets_;  ///< meshes used in this tick
  bool is_paused_ = false;            ///< the session is paused: no ticks are counted
  Fault outside_ = Fault::kNone;      ///< fault to raise in the next tick
  bool is_ending_ = false;            ///< Fault::kRecordingFailed was raised
};

// A session runs the haptic loop with a scene and a device, in real or virtual time, until all its
// ticks are done, it is stopped, or a fault ends it. Worker threads prepare meshes and stiffness
// for the loop; observers record and show the ticks.

/// Runs a session and returns its result. After each tick, the thread that runs the ticks calls
/// `advance(dt_s)`, in which a simulated device advances its time. After the last tick, zero
/// torques are written before the other threads end. `workers`: the result of make_workers() for
/// the same scene, device, remesher and options.
SessionResult run_session(const Scene& scene, Remesher& remesher, HandDevice& device,
                          const std::function<void(double dt_s)>& advance,
                          const SessionOptions& options, SessionWorkers workers);

/// Creates the workers and then runs a session like the function above. Errors: those of
/// make_workers(). Do not use this function for a drive (the electronics of a device) behind a
/// link: such a drive ends the session if the first tick is late, and creating workers takes time.
Result<SessionResult> run_session(const Scene& scene, Remesher& remesher, HandDevice& device,
                                  const std::function<void(double dt_s)>& advance,
                                  const SessionOptions& options);

}  // namespace trocar::runtime
