// SPDX-License-Identifier: Apache-2.0
// Messages to the operator while a session runs: a fault, the reason why recovery is not granted
// yet, a recovery. The haptic thread pushes records of fixed size. Another thread turns each record
// into words and immediately calls the program's function.
// Tests: tests/runtime/telemetry/operator_messages_test.cpp
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "formats/session/fault_words.h"
#include "runtime/realtime/spsc_queue.h"
#include "runtime/telemetry/tick_observer.h"

namespace trocar::runtime {

/// Returns the message as one line, without the program's name.
std::string describe(const OperatorMessage& message);

class OperatorMessages final : public TickObserver {
 public:
  /// serve() calls `report`, never on the realtime haptic thread.
  explicit OperatorMessages(std::function<void(const OperatorMessage&)> report);
  ~OperatorMessages() override { stop(); }

  /// If kCapacity messages are already waiting, this message is lost. The summary still
  /// contains every fault.
  void on_message(const OperatorMessage& message) noexcept override { waiting_.push(message); }
  void on_tick(const TickView&) noexcept override {}
  void serve() override;

 private:
  static constexpr std::size_t kCapacity = 64;
  SpscQueue<OperatorMessage, kCapacity> waiting_;
  std::function<void(const OperatorMessage&)> report_;
};

/// Decides in each tick whether a requested recovery is delayed by a reason that has not been
/// reported yet. Each reason is reported once per fault.
class RecoveryWatch {
 public:
  /// A reason is reported only if it still exists this long after the request.
  static constexpr double kPatience_s = 0.1;

  void fault_latched() noexcept { *this = {}; }
  /// `waiting`: recovery was requested, and `running` has not begun. Returns true if the reason is
  /// to be reported.
  bool should_report(bool waiting, double t_s, const FaultDetail& found,
                     double retract_distance_m) noexcept;

 private:
  double requested_t_s_ = -1;
  std::uint64_t reported_ = 0;  ///< one bit for each fault, and one for a tool in material
};

/// Finds the messages of each tick. The haptic thread uses it.
class MessageSource {
 public:
  /// Returns the messages of this tick. They are valid until the next call.
  std::span<const OperatorMessage> update(const TickResult& result) noexcept;

 private:
  void add(OperatorMessage::Kind kind, const TickResult& result,
           const FaultDetail& detail) noexcept;

  RecoveryWatch watch_;
  Fault stopped_by_ = Fault::kNone;  ///< fault that ended `running`; none once it begins again
  std::array<OperatorMessage, 3> messages_;
  std::size_t count_ = 0;
};

}  // namespace trocar::runtime
