// SPDX-License-Identifier: Apache-2.0
// The options of a session, the number of its ticks, and the receiver of a live hand.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/recording.h"
#include "formats/session/telemetry.h"
#include "runtime/haptics/force_law.h"
#include "runtime/haptics/loop/haptic_loop.h"
#include "runtime/realtime/realtime_thread.h"
#include "runtime/session/recorder.h"
#include "runtime/session/session_publisher.h"

namespace trocar::runtime {

// The number of ticks of a session, and the rate of the ticks in a recording.

/// Returns the number of ticks of a session, at least 1. The ticks are at the times 0, 1/rate,
/// 2/rate, ... before `duration_s`.
std::uint64_t tick_count(double duration_s, double rate_Hz);

/// Returns the rate at which a recording was made. A rate fits if the time of row k equals
/// k / rate, bit for bit, for every row k. `stated_Hz`: the rate that the recording states; 0: none
/// is stated. If several rates fit, the function returns the stated rate if this rate fits,
/// otherwise the rate with the fewest decimal digits. `name`: the recording's name, for error
/// messages. Errors: kRefused if there are fewer than two rows, if the first time is not 0, if the
/// rate is outside kMinRate_Hz to kMaxRate_Hz, or if no rate fits.
Result<double> recorded_rate_Hz(std::span<const RecordingRow> rows, const std::string& name,
                                double stated_Hz = 0);

// Receives the messages of a live hand, which is a hand that a person moves while the session runs
// (TelemetryHand in formats/session/telemetry.h). The session passes the messages on to a
// HandReceiver. runtime/session/live_hand.h implements it, and decides what the messages do.

/// The haptic thread calls these functions.
class HandReceiver {
 public:
  virtual ~HandReceiver() = default;
  /// Takes the latest message. If no new message has arrived since the last call, `latest` is the
  /// same message again. The session calls this once in each tick period, also during a pause.
  /// `now_ns`: the present time on CLOCK_MONOTONIC. Returns kHand if the person has now taken the
  /// tool, kHandLetGo if the person has now let go, kHandLost if no message has arrived for too
  /// long, and otherwise none.
  virtual std::optional<TelemetryEventKind> receive(const TelemetryHand& latest,
                                                    std::int64_t now_ns) noexcept = 0;
  /// Moves the hand's target, to which springs pull the tip, to the tip's present position. The
  /// session calls this after a pause.
  virtual void restart_at_tip() noexcept = 0;
};

// The options of a session.

enum class Clock : std::uint8_t {
  kReal,     ///< ticks follow the wall clock; new meshes are used as soon as they are ready
  kVirtual,  ///< ticks follow each other without a pause; the same input gives the same recording
};

enum class RecoveryPolicy : std::uint8_t {
  kNever,      ///< a fault ends the session once torques are zero
  kOnRequest,  ///< the session continues without torques until recovery is requested
  kAuto,       ///< as kOnRequest, and after a failed check recovery is requested by itself
};

/// Lets a program end the forces before it is stopped by a signal such as SIGTSTP.
struct Suspension {
  std::atomic<bool> is_requested{false};  ///< while true, the session is paused as by the operator
  std::atomic<std::uint64_t> paused_periods{0};  ///< periods in which zero force was written
};

struct SessionOptions {
  Clock clock = Clock::kReal;
  double rate_Hz = 1000;
  double duration_s = 1;  ///< duration of the session; in a replay, that of the recorded session
  std::optional<std::filesystem::path> record;  ///< file of the recording; none: no recording
  RecordingOrigin origin;                       ///< written into the recording and the black boxes
  /// Called if less than Recorder::kLowSpace_s of recording fit on the disk (recorder.h). If rows
  /// cannot be written, the session ends after a ramp of the forces, by Fault::kRecordingFailed.
  std::function<void(double left_s)> on_low_space;
  /// Called with each message to the operator, not on the realtime haptic thread.
  std::function<void(const OperatorMessage&)> on_message;
  /// If not empty, the session is a replay of these rows. The session uses the replay clock
  /// (session.h) and compares torques with the recorded torques. The device must replay the
  /// same rows (runtime/session/open_device.h).
  std::span<const RecordingRow> replay;
  SafetyLimits limits;
  bool guards = true;  ///< LoopModel::guards
  CouplingOptions coupling;
  StiffnessLimits stiffness;
  CompensationOptions compensation;
  RecoveryPolicy recovery = RecoveryPolicy::kNever;
  /// A flag that the program sets to request a recovery, for example after SIGUSR1
  /// (operator_messages.h). The next tick clears the flag. Null: no such flag.
  std::atomic<bool>* recover = nullptr;
  Suspension* suspension = nullptr;  ///< must outlive the session; may be null
  /// Folder of the black boxes, which keep the last seconds before a fault; none: no black boxes.
  std::optional<std::filesystem::path> black_box;
  int cpu = -1;  ///< processor of the haptic thread (RealtimeOptions::cpu); -1: any
  const std::atomic<bool>* stop = nullptr;  ///< flag that ends the session if true; may be null
  /// If set, the session is published in memory that other processes read, and the session obeys
  /// their commands (formats/session/telemetry.md).
  std::optional<TelemetryOptions> telemetry;
  /// True: the session accepts the operator's X-ray commands (operator_messages.h) from other
  /// processes, or from the rows of a replay, and counts shots and the time of screening.
  bool counts_xray = false;
  /// Receives the messages of a hand that a person moves. The messages come through `telemetry`,
  /// which must then be set. Null: there is no such hand. The receiver must outlive the session.
  HandReceiver* hand = nullptr;
  /// Called with the frames for a display (session_publisher.h), not on the realtime haptic thread.
  FrameFunction on_frame;
  double frame_rate_Hz = 30;
  /// Called with every tick, in order, not on the realtime haptic thread.
  std::function<void(const ObservedTick&)> on_tick;
  std::vector<TickObserver*> observers;  ///< further observers; they must outlive the session

  /// True if ticks follow the wall clock.
  bool is_real_time() const noexcept { return clock == Clock::kReal && replay.empty(); }
  /// True if the flag `stop` is set.
  bool is_stopped() const noexcept { return stop != nullptr && stop->load(); }
  /// The options of the haptic thread.
  RealtimeOptions realtime() const noexcept {
    return {.rate_Hz = rate_Hz, .cpu = cpu, .stop = stop};
  }
};

/// The error of a check, a proposal or a trial that SessionOptions::stop has ended: it has no result.
inline Error interrupted() {
  return {ExitCode::kDeviceFault, "interrupted; nothing was written"};
}

}  // namespace trocar::runtime
