// SPDX-License-Identifier: Apache-2.0
// A session: the haptic loop run over a scene for its duration, in real or in
// virtual time, with its workers, and what happened in it.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "formats/session/device_description.h"
#include "formats/session/scene.h"
#include "runtime/simulation/simulated_device.h"
#include "runtime/session/black_box.h"
#include "runtime/control/haptic_loop.h"
#include "runtime/realtime/histogram.h"
#include "runtime/realtime/realtime_thread.h"
#include "runtime/session/responder.h"
#include "runtime/realtime/triple_buffer.h"
#include "runtime/session/workers.h"

namespace trocar::runtime {

enum class Clock : std::uint8_t {
  kReal,     ///< wall clock; new meshes are used as soon as they are there
  kVirtual,  ///< as fast as it goes, deterministic: the same input gives the same recording
};

enum class RecoveryPolicy : std::uint8_t {
  kNever,      ///< a fault ends the session once torques are zero
  kOnRequest,  ///< the session goes on without torques until recovery is asked for
  kAuto,       ///< recovery is asked for as soon as torques are zero
};

struct SessionOptions {
  Clock clock = Clock::kReal;
  double rate_Hz = 1000;
  double duration_s = 1;
  /// Virtual clock: ticks from a request for a hole, or for a sheet's response, to its use.
  std::uint64_t handover_ticks = 8;
  /// Virtual clock: a response is asked for once in this time.
  double response_period_s = 0.004;
  std::optional<std::filesystem::path> record;
  /// If not empty: virtual clock, hand-overs where these rows have them, and the torques are
  /// compared with theirs. The device must be a ReplayDevice over the same rows.
  std::span<const RecordingRow> replay;
  SafetyLimits limits;
  PassivityOptions passivity;
  CouplingOptions coupling;
  CompensationOptions compensation;
  RecoveryPolicy recovery = RecoveryPolicy::kNever;
  std::atomic<bool>* recover = nullptr;  ///< kOnRequest: set by the operator, cleared when taken
  /// Where a fault leaves its black box; none: nowhere.
  std::optional<std::filesystem::path> black_box;
  int cpu = -1;                                ///< RealtimeOptions::cpu
  const std::atomic<bool>* stop = nullptr;     ///< ends the session between two ticks
  TripleBuffer<RecordingRow>* live = nullptr;  ///< gets every row
  /// Called at the frame rate, never on the haptic thread, with the latest row and, by `network`,
  /// the sheet around the tool (else null).
  std::function<void(const RecordingRow&, const std::shared_ptr<const SheetShape>&)> on_frame;
  double frame_rate_Hz = 30;
};

inline constexpr std::size_t kMaxListedFaults = 256;

enum class SessionEnd : std::uint8_t { kDone, kInterrupted, kFault };

struct PunctureEvent {
  std::int32_t sheet = -1;  ///< the topmost is 0
  std::int32_t slice = -1;  ///< asset's index
  std::uint32_t cut = 0;    ///< of this sheet, from 1
  double t_s = 0;
  double tool_z_m = 0;
  double penetration_m = 0;   ///< that the sheet did not stand
  double force_N = 0;         ///< the last one felt before
  double judged_force_N = 0;  ///< the one it did not stand
};

struct FaultEvent {
  Fault fault = Fault::kNone;
  double t_s = 0;
  double rest_t_s = -1;       ///< when torques were zero; -1: not before the end
  double recovered_t_s = -1;  ///< when forces were rendered again; likewise
};

struct SessionReport {
  SessionEnd end = SessionEnd::kDone;
  std::uint64_t ticks = 0;
  Fault fault = Fault::kNone;  ///< that is latched at the end
  double fault_t_s = 0;
  std::vector<FaultEvent> faults;  ///< all, the first kMaxListedFaults of them
  std::uint64_t faults_count = 0;
  std::optional<Error> recording_error;  ///< there is no recording: it could not be written whole
  std::vector<BlackBoxFile> black_boxes;
  std::uint64_t black_boxes_lost = 0;
  double energy_given_max_J = 0;     ///< PassivityState::given_max_J
  double damping_max_N_s_per_m = 0;  ///< added by the passivity controller
  std::uint64_t damped_ticks = 0;
  RealtimeReport realtime;  ///< virtual clock: empty
  Histogram tick;           ///< wall time of a tick, from reading the device to publishing
  std::optional<std::uint64_t> allocations_in_loop;  ///< none: not counted in this build
  double max_force_N = 0;
  double torque_max_Nm = 0;
  double wrench_error_max = 0;     ///< |delivered - wanted| / |wanted|, torques over 0.05 m
  std::uint64_t scaled_ticks = 0;  ///< in which the motors could not give the wanted wrench
  std::vector<PunctureEvent> punctures;
  std::uint64_t punctures_not_listed = 0;
  std::optional<ResponderReport> responder;  ///< force law `network`
  /// Replay: the first row whose torques, bit for bit, or hand-over differ; -1: none does.
  std::int64_t replay_first_difference = -1;
};

/// The device of the scene's hand, at the hand's first keyframe; without mechanics the light model.
Result<SimulatedDevice> make_simulated_device(
    const Scene& scene, const DeviceDescription& description,
    const std::optional<MechanicsOptions>& mechanics = std::nullopt);

/// What a session makes before its first tick, in a time that no drive would wait for.
struct SessionWorkers {
  std::unique_ptr<Recorder> recorder;    ///< if there is to be a recording
  std::unique_ptr<BlackBox> black_box;   ///< if a folder is named
  std::unique_ptr<Responder> responder;  ///< by `network`
};

/// Errors: the recording cannot be written, or the folder of the black box (unwritable; what fails
/// later is said in the report); by `network`, a tissue or tool that no membrane fits (refused).
Result<SessionWorkers> make_workers(const Scene& scene, const Remesher& remesher,
                                    const SessionOptions& options);

/// Runs. `advance(dt_s)` is called after each tick, on the same thread: a simulated device's step.
/// Ends with torques at zero, which is written before anything else is ended. `workers`: as from
/// make_workers for these arguments.
SessionReport run_session(const Scene& scene, const DeviceDescription& description,
                          Remesher& remesher, Device& device,
                          const std::function<void(double dt_s)>& advance,
                          const SessionOptions& options, SessionWorkers workers);

/// The same, with workers made for it; their errors. For devices that can wait: a drive behind a
/// link ends a session in which no tick comes.
Result<SessionReport> run_session(const Scene& scene, const DeviceDescription& description,
                                  Remesher& remesher, Device& device,
                                  const std::function<void(double dt_s)>& advance,
                                  const SessionOptions& options);

/// Ticks of a session: one at 0, then one every 1/rate until, not including, its end.
std::uint64_t tick_count(double duration_s, double rate_Hz);

/// The rate at which a recording was made: its times are k / rate, bit for bit (of several such
/// rates the shortest decimal); refused if there is none.
Result<double> recorded_rate_Hz(std::span<const RecordingRow> rows, const std::string& name);

}  // namespace trocar::runtime
