// SPDX-License-Identifier: Apache-2.0
// What happened in a session, collected tick by tick.
// Tests: tests/runtime/session/session_test.cpp
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/fault_words.h"
#include "formats/session/recording.h"
#include "formats/session/xray_use.h"
#include "runtime/contact/force_law.h"
#include "runtime/realtime/histogram.h"
#include "runtime/realtime/late_ticks.h"
#include "runtime/realtime/realtime_thread.h"
#include "runtime/telemetry/black_box.h"
#include "runtime/telemetry/tick_observer.h"

namespace trocar::runtime {

inline constexpr std::size_t kMaxListedFaults = 256;
inline constexpr std::size_t kMaxListedPunctures = 4096;

enum class SessionEnd : std::uint8_t { kDone, kInterrupted, kFault };

struct FaultEvent {
  Fault fault = Fault::kNone;
  FaultDetail detail;  ///< measured value and limit
  double t_s = 0;
  double torques_zero_t_s = -1;  ///< time at which torques had become zero; -1: they had not
  double recovered_t_s = -1;     ///< time at which the state `running` began again; -1: it did not
};

/// The result of run_session(), for the program. SUMMARY.json contains most of it
/// (runtime/reporting/summary.h). This is not the session report for the trainee: that one
/// (`--session-report`, runtime/reporting/session_report.h) is made from SessionFigures.
struct SessionResult {
  SessionEnd end = SessionEnd::kDone;
  std::uint64_t ticks = 0;
  Fault fault = Fault::kNone;      ///< fault latched at the end of the session
  double fault_t_s = 0;            ///< time at which this fault was latched
  std::vector<FaultEvent> faults;  ///< the first kMaxListedFaults faults
  std::uint64_t faults_count = 0;
  std::optional<Error> recording_error;  ///< the recording is incomplete; the error names its file
  std::vector<BlackBoxFile> black_boxes;
  std::uint64_t black_boxes_lost = 0;  ///< BlackBox::lost()
  double energy_released_max_J = 0;    ///< largest net energy that the hand received in a contact
  double damping_max_N_s_per_m = 0;    ///< largest damping of the passivity controller
  std::uint64_t damped_ticks = 0;      ///< ticks in which the passivity controller added damping
  RealtimeReport realtime;             ///< empty with a virtual clock
  LateTicks::Counts late_ticks{};  ///< missed deadlines by the part of the tick that caused them
  Histogram tick;                  ///< wall time of a tick, without the simulated device's step
  Histogram device;                ///< part of `tick`: reading, checking and writing the device
  std::optional<std::uint64_t> allocations_in_loop;  ///< none: not counted
  /// Largest delivered force. It contains everything that acts on the hand: sheet, shaft, rim of
  /// the hole, coupling and damping. It does not contain the compensation of the device's own
  /// forces, because the hand does not feel this compensation.
  double max_force_N = 0;
  double torque_max_Nm = 0;
  XrayUse xray;
  // Authority is the factor on the force; after a recovery it rises from 0 to 1. The next two
  // members count only ticks with authority 1.
  /// Largest relative error of the delivered wrench: |delivered - wanted| / |wanted|. In this norm
  /// torques are divided by 0.05 m.
  double wrench_error_max = 0;
  /// Number of ticks in which the device could not render the whole wrench.
  std::uint64_t scaled_ticks = 0;
  std::vector<PunctureEvent> punctures;    ///< the first kMaxListedPunctures punctures
  std::uint64_t punctures_not_listed = 0;  ///< number of punctures beyond those
  /// Number of ticks that SessionOptions::on_tick did not get, because that function was too slow.
  std::uint64_t ticks_not_observed = 0;
  std::shared_ptr<const ForceLaw> law;  ///< the force law after the last tick
  /// In a replay: index of the first row that differs from the recording; -1: no row differs. The
  /// comparison covers the fault, the number of finished holes, and all bits of the torques (of the
  /// wrench, for a device that measures its own pose).
  std::int64_t replay_first_difference = -1;
};

/// Fills a SessionResult tick by tick. The constructor reserves the memory.
class SessionStatistics final : public TickObserver {
 public:
  /// `replay`: SessionOptions::replay.
  explicit SessionStatistics(std::span<const RecordingRow> replay);

  void on_puncture(const PunctureEvent& puncture) noexcept override;
  void on_tick(const TickView& tick) noexcept override;
  /// Adds the durations of one tick. `duration_ns`: the whole tick, without the simulated device's
  /// step. `device_ns`: the part in which the device was read, checked and written.
  void add_tick_time(std::int64_t duration_ns, std::int64_t device_ns) noexcept {
    report_.tick.add(duration_ns);
    report_.device.add(device_ns);
  }

  /// Returns the report. Called once, after the last tick. `is_complete`: every tick of the
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
