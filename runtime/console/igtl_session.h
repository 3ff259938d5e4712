// SPDX-License-Identifier: Apache-2.0
// Passes poses, forces, state and surface of the console's session to OpenIGTLink clients, such as
// 3D Slicer (docs/openigtlink.md).
// Tests: tests/e2e/console_igtl_test.py
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>

#include "runtime/console/answers/bone.h"
#include "runtime/console/console_state.h"
#include "runtime/console/igtl/igtl_server.h"

namespace trocar::runtime {

/// Gives an IgtlServer the telemetry that the supervisor has read. The bone of a session is loaded
/// only if there is a client, and on the worker thread.
class IgtlSession {
 public:
  using Clock = std::chrono::steady_clock;
  IgtlSession(ConsoleState& console, std::unique_ptr<IgtlServer> server)
      : console_(console), server_(std::move(server)) {}

  /// Call this after each poll of the supervisor.
  void poll(Clock::time_point now);

 private:
  /// The position of the session's bone in the patient, and the packed message
  /// with the bone's surface.
  struct Position {
    std::optional<Eigen::Affine3d> T_patient_device;
    IgtlBytes surface;
  };
  void load_position();
  void update_status(double now_unix_s);
  void update_tick(double taken_unix_s);

  ConsoleState& console_;
  std::unique_ptr<IgtlServer> server_;
  IgtlState state_;
  std::optional<std::uint64_t> asked_;  ///< the session whose position is loaded or being loaded
  std::optional<Position> position_;    ///< nullopt: not loaded yet
  double shown_ticks_ = 0;              ///< tick count of the pose that was sent last
  std::pair<RunState, int> shown_status_{RunState::kIdle, -1};  ///< state and fault sent last
};

}  // namespace trocar::runtime
