// SPDX-License-Identifier: Apache-2.0
// The console's session as OpenIGTLink clients get it (docs/openigtlink.md).
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

/// Gives what the supervisor has read to an IgtlServer. Bones are loaded on the worker thread, and only
/// if there is a client.
class IgtlSession {
 public:
  using Clock = std::chrono::steady_clock;
  IgtlSession(ConsoleState& console, std::unique_ptr<IgtlServer> server)
      : console_(console), server_(std::move(server)) {}

  /// Call this after each poll of the supervisor.
  void poll(Clock::time_point now);

 private:
  /// The session's position in the patient, and its surface, ready to be sent.
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
  std::optional<std::uint64_t> asked_;  ///< the session whose position is known or is being loaded
  std::optional<Position> position_;    ///< none: not known yet
  double shown_ticks_ = 0;              ///< number of ticks at the last pose
  std::pair<RunState, int> shown_status_{RunState::kIdle, -1};  ///< last sent state and fault
};

}  // namespace trocar::runtime
