// SPDX-License-Identifier: Apache-2.0
// A session: runs the haptic loop over a scene for its duration, in real or virtual time, with its
// worker threads, and reports what happened.
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
#include "runtime/control/haptic_loop.h"
#include "runtime/realtime/histogram.h"
#include "runtime/realtime/realtime_thread.h"
#include "runtime/realtime/triple_buffer.h"
#include "runtime/session/black_box.h"
#include "runtime/session/live_view.h"
#include "runtime/session/notices.h"
#include "runtime/session/responder.h"
#include "runtime/session/session_body.h"
#include "runtime/session/tick_feed.h"
#include "runtime/session/workers.h"
#include "runtime/simulation/simulated_device.h"

namespace trocar::runtime {

enum class Clock : std::uint8_t {
  kReal,     ///< wall clock; new meshes are used as soon as they are ready
  kVirtual,  ///< as fast as possible, deterministic: same input, same recording
};

enum class RecoveryPolicy : std::uint8_t {
  kNever,      ///< a fault ends the session once torques are zero
  kOnRequest,  ///< the session continues without torques until recovery is requested
  kAuto,       ///< recovery is requested as soon as torques are zero
};

struct SessionOptions {
  Clock clock = Clock::kReal;
  double rate_Hz = 1000;
  double duration_s = 1;
  /// Virtual clock: ticks from the request for a hole or a response to its use.
  std::uint64_t handover_ticks = 8;
  /// Virtual clock: period of requests for a response.
  double response_period_s = 0.004;
  std::optional<std::filesystem::path> record;
  RecordingOrigin origin;  ///< for the recording and the black boxes
  /// Called at once when the recording cannot be written on, never on the realtime haptic thread.
  /// The session goes on without it.
  std::function<void(const Error&)> on_recording_error;
  /// Called at once with each notice, never on the realtime haptic thread.
  std::function<void(const Notice&)> on_notice;
  /// If not empty: virtual clock; new meshes and responses come into use in the recorded ticks, and
  /// torques are compared with the recorded ones. The device must be a ReplayDevice over these
  /// rows.
  std::span<const RecordingRow> replay;
  SafetyLimits limits;
  PassivityOptions passivity;
  CouplingOptions coupling;
  CompensationOptions compensation;
  RecoveryPolicy recovery = RecoveryPolicy::kNever;
  /// kOnRequest: set by the operator, cleared when it takes effect.
  std::atomic<bool>* recover = nullptr;
  /// Folder of the black boxes; none: they are not written.
  std::optional<std::filesystem::path> black_box;
  int cpu = -1;                                ///< RealtimeOptions::cpu
  const std::atomic<bool>* stop = nullptr;     ///< ends the session between two ticks
  TripleBuffer<RecordingRow>* live = nullptr;  ///< receives every row
  /// Shows the session in memory that other processes read, and takes their commands
  /// (formats/session/live_memory.md).
  std::optional<LiveOptions> live_memory;
  /// Called at the frame rate, never on the realtime haptic thread, with the latest row and, with
  /// the force law `network`, the sheet around the tool (else null).
  std::function<void(const RecordingRow&, const std::shared_ptr<const SheetShape>&)> on_frame;
  double frame_rate_Hz = 30;
  /// Called with every tick in order, never on the realtime haptic thread.
  std::function<void(const SeenTick&)> on_tick;
};

inline constexpr std::size_t kMaxListedFaults = 256;

enum class SessionEnd : std::uint8_t { kDone, kInterrupted, kFault };

struct PunctureEvent {
  std::int32_t sheet = -1;  ///< the topmost is 0
  std::int32_t slice = -1;  ///< AssetSlice::index
  std::uint32_t cut = 0;    ///< number of the hole in this sheet, from 1
  double t_s = 0;
  double tool_z_m = 0;
  double penetration_m = 0;   ///< at which the sheet was punctured
  double force_N = 0;         ///< at the tip, times force_scale: the last one before
  double judged_force_N = 0;  ///< of the tissue: the one that exceeded the threshold
};

struct FaultEvent {
  Fault fault = Fault::kNone;
  FaultDetail detail;  ///< of it: what was measured
  double t_s = 0;
  double rest_t_s = -1;       ///< when torques were zero; -1: not before the end
  double recovered_t_s = -1;  ///< when `running` was entered again; -1: not before the end
};

/// Of the tissue: not scaled.
struct CuttingReport {
  DeviceCoupling coupling;
  double force_scale = 1;
  double tip_max_N = 0, force_max_N = 0;
  BodyLedger ledger;  ///< at the end
  std::uint64_t unconverged_ticks = 0;
  int steps_max = 0;
  std::uint64_t side_cuts = 0;  ///< where walls yielded
};

struct SessionReport {
  SessionEnd end = SessionEnd::kDone;
  std::uint64_t ticks = 0;
  Fault fault = Fault::kNone;  ///< latched at the end
  double fault_t_s = 0;
  std::vector<FaultEvent> faults;  ///< the first kMaxListedFaults
  std::uint64_t faults_count = 0;
  std::optional<Error> recording_error;  ///< the recording is not whole; it names what was kept
  std::vector<BlackBoxFile> black_boxes;
  std::uint64_t black_boxes_lost = 0;
  double energy_given_max_J = 0;     ///< PassivityState::given_max_J
  double damping_max_N_s_per_m = 0;  ///< added by the passivity controller
  std::uint64_t damped_ticks = 0;
  RealtimeReport realtime;  ///< virtual clock: empty
  Histogram tick;           ///< wall time of a tick, without the simulated device's step
  std::optional<std::uint64_t> allocations_in_loop;  ///< none: not counted
  /// Of all that acts on the hand, as delivered: sheet, shaft, rim, coupling, damping. Compensation
  /// of the device's own forces is not felt and does not count.
  double max_force_N = 0;
  double torque_max_Nm = 0;
  double wrench_error_max = 0;     ///< |delivered - wanted| / |wanted|, torques over 0.05 m
  std::uint64_t scaled_ticks = 0;  ///< in which the motors could not render the whole wrench
  std::vector<PunctureEvent> punctures;
  std::uint64_t punctures_not_listed = 0;
  std::uint64_t ticks_not_seen = 0;          ///< that on_tick did not get: its thread was too slow
  std::optional<ResponderReport> responder;  ///< force law `network`
  std::optional<CuttingReport> cutting;      ///< force law `cutting`
  /// Replay: the first row (from 0) whose torques differ by a bit, or whose fault or cuts differ;
  /// -1: none.
  std::int64_t replay_first_difference = -1;
};

/// The path that the scene's hand pulls the tool's tip along.
HandTrajectory hand_trajectory(const Scene& scene);

/// The simulated device held by the scene's hand, at the hand's first keyframe. Without
/// `mechanics`: the light model.
Result<SimulatedDevice> make_simulated_device(
    const Scene& scene, const DeviceDescription& description,
    const std::optional<MechanicsOptions>& mechanics = std::nullopt);

/// Workers of a session. Creating them takes longer than a drive waits for its first tick, so they
/// are created before the link is opened.
struct SessionWorkers {
  std::unique_ptr<Recorder> recorder;    ///< if SessionOptions::record is set
  std::unique_ptr<BlackBox> black_box;   ///< if SessionOptions::black_box is set
  std::unique_ptr<TickFeed> tick_feed;   ///< if SessionOptions::on_tick is set; real clock
  std::unique_ptr<Responder> responder;  ///< with the force law `network`
  std::optional<SessionBody> body;       ///< with the force law `cutting`
  std::unique_ptr<LiveView> live;        ///< if SessionOptions::live_memory is set
};

/// Unwritable: the recording or the folder of the black boxes cannot be written (later failures are
/// in the report). Refused: with `network`, a tissue or tool for which calibration finds no
/// membrane; with `cutting`, as make_body().
Result<SessionWorkers> make_workers(const Scene& scene, const DeviceDescription& description,
                                    const Remesher& remesher, const SessionOptions& options);

/// Runs a session. `advance(dt_s)` is called after each tick on the same thread: a simulated
/// device's step. At the end zero torques are written first, then the other threads end. `workers`:
/// as from make_workers for these arguments.
SessionReport run_session(const Scene& scene, const DeviceDescription& description,
                          Remesher& remesher, Device& device,
                          const std::function<void(double dt_s)>& advance,
                          const SessionOptions& options, SessionWorkers workers);

/// The same, and creates the workers; errors as make_workers. Not for a drive behind a link, which
/// ends a session whose first tick comes late.
Result<SessionReport> run_session(const Scene& scene, const DeviceDescription& description,
                                  Remesher& remesher, Device& device,
                                  const std::function<void(double dt_s)>& advance,
                                  const SessionOptions& options);

/// Number of ticks of a session: at 0, 1/rate, 2/rate, ... before its end.
std::uint64_t tick_count(double duration_s, double rate_Hz);

/// The rate at which a recording was made: its times are k / rate, bit for bit. Of several such
/// rates `stated_Hz` (0: none), else the shortest decimal. Refused if there is none.
Result<double> recorded_rate_Hz(std::span<const RecordingRow> rows, const std::string& name,
                                double stated_Hz = 0);

}  // namespace trocar::runtime
