// SPDX-License-Identifier: Apache-2.0
// Passes data of the console's session to OpenIGTLink clients, such as 3D Slicer: the tool's pose,
// the force, the session's state, and the bone's surface (docs/openigtlink.md).
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>

#include "runtime/console/answers.h"
#include "runtime/console/igtl.h"
#include "runtime/console/server.h"

namespace trocar::runtime {

/// Gives an IgtlServer the telemetry that the supervisor has read. If there is a client, the worker
/// thread (ConsoleState::worker) also loads the bone of the session.
class IgtlSession {
 public:
  using Clock = std::chrono::steady_clock;
  IgtlSession(ConsoleState& console, std::unique_ptr<IgtlServer> server)
      : console_(console), server_(std::move(server)) {}

  /// Call this after each poll of the supervisor.
  void poll(Clock::time_point now);

 private:
  /// T_patient_device: the member of PatientBone (answers/bone.h). surface: the message with the
  /// bone's surface; null: no surface.
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
  std::optional<std::uint64_t> asked_;  ///< number of the session for which loading has begun
  std::optional<Position> position_;    ///< nullopt: not loaded yet
  double shown_ticks_ = 0;              ///< number of ticks done when the last sent pose was taken
  std::pair<RunState, int> shown_status_{RunState::kIdle, -1};  ///< state and fault sent last
};

}  // namespace trocar::runtime
