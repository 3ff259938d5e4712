// SPDX-License-Identifier: Apache-2.0
// The haptic tick of a session. Inputs are the device's pose, the operator's commands and the
// current meshes. Outputs are the command to the device, requests for holes, and the result of the
// tick for the observers.
// Tests: tests/runtime/session/session_test.cpp
#pragma once

#include <functional>
#include <vector>

#include "formats/session/scene.h"
#include "runtime/control/haptic_loop.h"
#include "runtime/device/hand_device.h"
#include "runtime/realtime/late_ticks.h"
#include "runtime/session/operator_commands.h"
#include "runtime/session/session_clock.h"
#include "runtime/session/session_options.h"
#include "runtime/session/session_statistics.h"
#include "runtime/session/session_workers.h"
#include "runtime/session/xray_commands.h"
#include "runtime/telemetry/operator_messages.h"
#include "runtime/workers/remesher.h"

namespace trocar::runtime {

class SessionLoop {
 public:
  /// All references must outlive the loop. `advance(dt_s)` is called after each tick with the
  /// duration of a tick; it moves a simulated device.
  SessionLoop(const Scene& scene, Remesher& remesher, HandDevice& device,
              const std::function<void(double dt_s)>& advance, const SessionOptions& options,
              const SessionWorkers& workers, SessionClock& clock);

  // The haptic thread calls these functions.

  /// Runs one tick. While the session is paused, only takes commands, writes zero torques to a
  /// device with its own clock, and updates the telemetry. Returns false if the session is over.
  bool tick(const TickTiming& timing) noexcept;
  void write_zero_torques() noexcept { device_.write_zero(); }

  // The thread that calls tick() may call these functions between two ticks (in virtual time).

  std::uint64_t ticks_done() const noexcept { return state_.tick; }
  bool is_paused() const noexcept { return is_paused_; }
  const ContactOutput& contact() const noexcept { return result_.contact; }

  // The thread that publishes meshes calls this function.

  /// Makes new meshes visible to other processes.
  void publish_sheets();

  // The thread that runs the session calls these functions.

  void start_observers();
  void serve_observers();
  /// Ends the observers and returns the report. Called after the last tick.
  SessionResult finish();

 private:
  void receive_hand(std::int64_t now_ns) noexcept;
  std::uint8_t xray_of_tick() noexcept;
  bool pauses(std::int64_t now_ns) noexcept;
  TickInputs inputs(const TickTiming& timing) noexcept;
  void request_hole(const CutRequest& cut) noexcept;
  bool goes_on() const noexcept;

  LoopModel model_;
  LoopState state_;
  TickResult result_;
  double last_hand_N_ = 0;  ///< force on the hand in the previous tick
  Remesher& remesher_;
  HandDevice& device_;
  ForceLaw& law_;
  const std::function<void(double)>& advance_;
  const SessionOptions& options_;
  SessionClock& clock_;
  SessionPublisher* publisher_;  ///< source of the operator's commands; null: none
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
};

}  // namespace trocar::runtime
