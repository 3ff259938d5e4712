// SPDX-License-Identifier: Apache-2.0
// The result of a session, collected tick by tick.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/faults.h"
#include "formats/session/recording.h"
#include "formats/session/telemetry.h"
#include "formats/session/trainee.h"
#include "runtime/haptics/force_law.h"
#include "runtime/realtime/histogram.h"
#include "runtime/realtime/realtime_thread.h"
#include "runtime/session/recorder.h"

namespace trocar::runtime {

inline constexpr std::size_t kMaxListedFaults = 256;
inline constexpr std::size_t kMaxListedPunctures = 4096;

/// kFault: when the session ended, a fault was latched for which is_failure() is true. Otherwise kDone if all ticks of SessionOptions::duration_s were
/// done, and kInterrupted if not. So the replay of an interrupted session is interrupted, too.
using SessionEnd = TelemetryEnd;

struct FaultEvent {
  Fault fault = Fault::kNone;
  FaultDetail detail;            ///< measured value and limit
  double t_s = 0;                ///< time at which the fault was latched
  double torques_zero_t_s = -1;  ///< time at which torques became zero; -1: they did not
  double recovered_t_s = -1;     ///< time at which the state `running` began again; -1: it did not
};

/// The result of run_session(), for the program and for the summary (runtime/report/session_report.h).
/// The session report for the trainee (`--session-report`, runtime/report/session_report.h) is
/// made from SessionFigures and from some members of this result.
struct SessionResult {
  SessionEnd end = SessionEnd::kDone;
  std::uint64_t ticks = 0;
  Fault fault = Fault::kNone;            ///< fault that was latched when the session ended
  double fault_t_s = 0;                  ///< time at which `fault` was latched
  std::vector<FaultEvent> faults;        ///< the first kMaxListedFaults faults
  std::uint64_t faults_count = 0;        ///< number of all faults
  std::optional<Error> recording_error;  ///< why the recording is incomplete; none: no error
  std::vector<BlackBoxFile> black_boxes;
  std::uint64_t black_boxes_lost = 0;  ///< requests for a black box lost because a queue was full
  double energy_released_max_J = 0;    ///< largest net energy that the hand received in a contact
  double guard_least = 1;              ///< smallest factor of the guard
  std::uint64_t guarded_ticks = 0;     ///< ticks in which the guard had softened the force
  RealtimeReport realtime;             ///< empty with a virtual clock
  LateTicks::Counts late_ticks{};      ///< missed deadlines that each part of the tick has caused
  Histogram tick;                      ///< wall time of a tick, without simulating the device
  Histogram device;  ///< part of `tick` for reading, checking and writing the device
  std::optional<std::uint64_t> allocations_in_loop;  ///< allocations in ticks; none: not counted
  /// Largest force that was delivered to the hand. It contains all forces that the hand feels:
  /// sheet, shaft, rim of the hole, coupling and damping. It does not contain the compensation of
  /// the device's own friction and weight, because the hand does not feel this compensation.
  double max_force_N = 0;
  double torque_max_Nm = 0;
  XrayUse xray;
  // Authority is the factor on the force. After a recovery it rises from 0 to 1. While authority is
  // below 1, the force is reduced on purpose. So the next two members are computed only from ticks
  // with authority 1.
  /// Largest relative error of the delivered wrench: |delivered - wanted| / |wanted|. In the norm
  /// |.| of a wrench, torques are divided by 0.05 m, so that they count as forces.
  double wrench_error_max = 0;
  /// Number of ticks in which the device could not render the whole wrench.
  std::uint64_t scaled_ticks = 0;
  std::vector<PunctureEvent> punctures;    ///< the first kMaxListedPunctures punctures
  std::uint64_t punctures_not_listed = 0;  ///< number of punctures that are not in `punctures`
  std::vector<BreakThroughEvent> break_throughs;  ///< the first kMaxListedPunctures of them
  /// Number of ticks that SessionOptions::on_tick did not get, because on_tick was too slow.
  std::uint64_t ticks_not_observed = 0;
  std::shared_ptr<const ForceLaw> law;  ///< the force law after the last tick
  /// In a replay: index of the first row that differs from the recording; -1: no row differs. These
  /// columns are compared: the fault, the number of holes in the meshes used, and all bits of the
  /// torques. For a device that measures its own pose, the wrench is compared instead of torques.
  std::int64_t replay_first_difference = -1;
};

/// Fills a SessionResult tick by tick. The constructor reserves the memory.
class SessionStatistics final : public TickObserver {
 public:
  /// `replay`: SessionOptions::replay.
  explicit SessionStatistics(std::span<const RecordingRow> replay);

  void on_puncture(const PunctureEvent& puncture) noexcept override;
  void on_break_through(const BreakThroughEvent& found) noexcept override;
  void on_tick(const TickView& tick) noexcept override;
  /// Adds the durations of one tick. `duration_ns`: the whole tick, without the time to simulate
  /// the device. `device_ns`: the part in which the device was read, checked and written.
  void add_tick_time(std::int64_t duration_ns, std::int64_t device_ns) noexcept {
    report_.tick.add(duration_ns);
    report_.device.add(device_ns);
  }

  /// Returns the result. Call this once, after the last tick. `is_complete`: every tick of the
  /// session was done.
  SessionResult take(const LoopState& state, bool is_complete);

 private:
  void count_faults(const TickView& tick) noexcept;
  void compare_with_replay(const TickView& tick) noexcept;
  void measure_wrench(const RecordingRow& row) noexcept;

  std::span<const RecordingRow> replay_;
  SessionResult report_;
};

}  // namespace trocar::runtime
