// SPDX-License-Identifier: Apache-2.0
// Messages to the operator while a session runs: a fault, a recovery, a refused request for
// recovery, or the reason why a requested recovery has not happened yet. The haptic thread pushes messages into a queue. Another
// thread passes each message to the program's function. describe() puts a message into words.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "formats/session/faults.h"
#include "runtime/realtime/queues.h"
#include "runtime/session/recorder.h"

namespace trocar::runtime {

/// Returns the message as one line, without the program's name.
std::string describe(const OperatorMessage& message);

class OperatorMessages final : public TickObserver {
 public:
  /// serve() calls `report` with each message, never on the realtime haptic thread.
  explicit OperatorMessages(std::function<void(const OperatorMessage&)> report);
  ~OperatorMessages() override { stop(); }

  /// If kCapacity messages are already waiting, this message is lost.
  void on_message(const OperatorMessage& message) noexcept override { waiting_.push(message); }
  void on_tick(const TickView&) noexcept override {}
  void serve() override;

 private:
  static constexpr std::size_t kCapacity = 64;
  SpscQueue<OperatorMessage, kCapacity> waiting_;
  std::function<void(const OperatorMessage&)> report_;
};

/// Decides in each tick whether to report the reason that delays a requested recovery. After a
/// fault, each reason is reported once.
class RecoveryWatch {
 public:
  /// A reason is reported only if it still exists this long after the request.
  static constexpr double kPatience_s = 0.1;

  /// Call this when a fault is latched. After that, each reason can be reported once again.
  void fault_latched() noexcept { *this = {}; }
  /// Call this once in each tick. Returns true if the caller is to report the reason now.
  /// `waiting`: recovery was requested, and the state `running` has not begun. If `found` has a
  /// fault, this fault is the reason. Otherwise, if `retract_distance_m` is positive, the reason is
  /// that the tool is in material and must first be retracted by this distance.
  bool should_report(bool waiting, double t_s, const FaultDetail& found,
                     double retract_distance_m) noexcept;

 private:
  double requested_t_s_ = -1;
  std::uint64_t reported_ = 0;  ///< reasons already reported: one bit per fault, one for the tool
};

/// Makes the messages of each tick, on the haptic thread.
class MessageSource {
 public:
  /// Shortest time between two messages kRefused.
  static constexpr double kRefusalPause_s = 0.1;

  /// Returns the messages of this tick. They are valid until the next call.
  std::span<const OperatorMessage> update(const TickResult& result) noexcept;

 private:
  void add(OperatorMessage::Kind kind, const TickResult& result,
           const FaultDetail& detail) noexcept;

  RecoveryWatch watch_;
  Fault stopped_by_ = Fault::kNone;  ///< latest latched fault; none once `running` begins again
  double refused_t_s_ = -kRefusalPause_s;  ///< time of the last message kRefused
  std::array<OperatorMessage, 3> messages_;
  std::size_t count_ = 0;
};

}  // namespace trocar::runtime
