// SPDX-License-Identifier: Apache-2.0
// What the operator commands while a session runs, and what the operator is told.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "formats/session/faults.h"
#include "formats/session/recording.h"
#include "runtime/realtime/queues.h"
#include "runtime/session/recorder.h"
#include "runtime/session/session_options.h"
#include "runtime/session/session_publisher.h"

namespace trocar::runtime {

// The operator's X-ray commands, which come from other processes. A shot is one picture. Screening
// is X-ray that stays on while a key is held. The process in which the key is held repeats the
// command for screening, so that the X-ray ends by itself if that process dies.

/// Only the haptic thread uses this class. It does not allocate.
class XrayCommands {
 public:
  /// Screening ends if its command has not been repeated for this long.
  static constexpr std::int64_t kHeld_ns = 1'000'000'000;
  /// Number of shots that can wait; further shots are dropped. Each tick takes one waiting shot.
  static constexpr std::uint64_t kMaxWaiting = 16;

  /// Applies the commands given since the last call. Call this once in each tick period, also in a
  /// pause, in which there are no ticks. A pause drops new and waiting shots, and ends screening
  /// until its command comes again after the pause. `now_ns`: CLOCK_MONOTONIC.
  void apply(const TelemetryCommands& given, bool is_paused, std::int64_t now_ns) noexcept {
    waiting_ =
        is_paused ? 0 : std::min(waiting_ + std::min(given.xray_shots, kMaxWaiting), kMaxWaiting);
    if (given.screening != word_) {
      word_ = given.screening;
      confirmed_ns_ = now_ns;
    }
    if (is_paused) confirmed_ns_ = now_ns - kHeld_ns;  // the key may be released in the pause
    is_held_ = (word_ & 1) != 0 && now_ns - confirmed_ns_ < kHeld_ns;
  }

  /// Takes one waiting shot, and returns RecordingRow::xray of this tick. Call this once in each
  /// tick, after apply().
  std::uint8_t take() noexcept {
    const bool has_shot = waiting_ > 0;
    if (has_shot) --waiting_;
    return static_cast<std::uint8_t>((has_shot ? kXrayPicture : 0) | (is_held_ ? kXrayBeam : 0));
  }

 private:
  // word_: last TelemetryCommands::screening, a counter that changes with each command for
  // screening and is odd while screening is requested. confirmed_ns_: time at which word_ last
  // changed; a pause sets it to kHeld_ns ago, which ends screening. waiting_: number of shots that
  // wait for a tick.
  std::uint64_t word_ = 0, waiting_ = 0;
  std::int64_t confirmed_ns_ = 0;
  bool is_held_ = false;
};

// The operator's commands while a session runs: pause, zero, emergency stop, resume, recover.
//
// Pause, zero (no forces) and emergency stop are latched: each stays set until it is released.
// While a command is set, the command's fault is raised in every tick, and no recovery begins.
// `resume` releases the pause. If the session's latched fault is that of the pause, `resume` also
// requests a recovery. `recover` releases all three commands and requests a recovery. The signal
// SIGUSR1 does the same as `recover`; the program's signal handler sets the flag
// SessionOptions::recover. With RecoveryPolicy::kNever, the signal has no effect after a failed
// check. A request goes to the tick that follows it, and is never kept: that tick takes or refuses
// it (safety.h).

class OperatorCommands {
 public:
  /// `recover`: the flag SessionOptions::recover; may be null.
  OperatorCommands(RecoveryPolicy policy, std::atomic<bool>* recover)
      : policy_(policy), recover_(recover) {}

  // The haptic thread calls these functions.

  /// Applies the commands given since the last call. If a stop is among them, it wins. `latched`:
  /// the fault that the safety state machine has latched (Safety::fault), or none. Call this once
  /// before each tick.
  void apply(const TelemetryCommands& given, Fault latched) noexcept;
  /// Returns the fault of the latched command, or none if no command is latched. The caller raises
  /// this fault in the tick.
  Fault latched_fault() const noexcept;
  bool is_paused() const noexcept { return is_paused_ && !emergency_stop_; }
  /// Returns true if `latched` is the fault of the command pause or zero, and no emergency stop is
  /// set. A session with RecoveryPolicy::kNever then waits for the operator instead of ending.
  bool waits_for_operator(Fault latched) const noexcept {
    return is_by_operator(latched) && !emergency_stop_;
  }
  /// Returns the request for recovery of this tick.
  RecoveryRequest request() const noexcept;

 private:
  RecoveryPolicy policy_;
  std::atomic<bool>* recover_;
  bool is_paused_ = false, forces_are_off_ = false, emergency_stop_ = false;
  bool is_recovery_requested_ = false;  ///< by the commands of the last apply()
};

// Messages to the operator while a session runs: a fault, a recovery, a refused request for
// recovery, or the reason why a requested recovery has not happened yet. The haptic thread pushes messages into a queue. Another
// thread passes each message to the program's function. describe() puts a message into words.

inline constexpr const char* kSoftenedWords =
    "the contact oscillates by itself, because the device is slower or noisier than its "
    "description "
    "says: measure it with trocar-run test";

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
  /// Shortest time between two messages kRefused, and between two kSoftened.
  static constexpr double kRefusalPause_s = 0.1, kSoftenedPause_s = 1;

  /// Returns the messages of this tick. They are valid until the next call.
  std::span<const OperatorMessage> update(const TickResult& result) noexcept;

 private:
  void add(OperatorMessage::Kind kind, const TickResult& result,
           const FaultDetail& detail) noexcept;

  RecoveryWatch watch_;
  Fault stopped_by_ = Fault::kNone;  ///< latest latched fault; none once `running` begins again
  double refused_t_s_ = -kRefusalPause_s;  ///< time of the last message kRefused
  double softened_t_s_ = -kSoftenedPause_s;
  std::array<OperatorMessage, 4> messages_;
  std::size_t count_ = 0;
};

}  // namespace trocar::runtime
