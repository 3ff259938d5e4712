// SPDX-License-Identifier: Apache-2.0
// Publishes a running session in shared memory: facts, snapshots, meshes and frames.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "formats/base/result.h"
#include "formats/mesh/triangle_grid.h"
#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "formats/session/telemetry.h"
#include "formats/session/trainee.h"
#include "runtime/device/hand_device.h"
#include "runtime/device/simulated/hand.h"
#include "runtime/haptics/force_law.h"
#include "runtime/haptics/loop/safety.h"
#include "runtime/haptics/sheet.h"
#include "runtime/haptics/tool.h"
#include "runtime/realtime/queues.h"
#include "runtime/realtime/realtime_thread.h"
#include "runtime/session/recorder.h"
#include "runtime/session/remesher.h"

namespace trocar::runtime {

// Supplies frames to a display at the display's frame rate. A frame consists of the latest row and
// the shape, which is the deformed sheet around the tool. Only the force law `network` has a shape.

/// Receives a frame: the latest row, and the shape or null.
using FrameFunction =
    std::function<void(const RecordingRow&, const std::shared_ptr<const SheetShape>&)>;

/// Calls a function with each frame, but never on the realtime haptic thread. In real time, the
/// wall clock determines when a frame is due; in virtual time, the number of ticks determines it.
class FrameDisplay final : public TickObserver {
 public:
  /// `show`: the function to call. `prefetch`: the worker that supplies the shape; may be null.
  /// `tick_rate_Hz`: rate of the ticks in virtual time; 0: real time.
  FrameDisplay(FrameFunction show, double frame_rate_Hz, double tick_rate_Hz,
               const PrefetchWorker* prefetch);
  ~FrameDisplay() override { stop(); }

  void on_tick(const TickView& tick) noexcept override;
  void serve() override;
  /// Ends the thread. Unlike TickObserver::stop(), this function does not call serve() once more.
  void stop() override { join(); }

 private:
  FrameFunction show_;
  double frame_rate_Hz_, tick_rate_Hz_;
  const PrefetchWorker* prefetch_;
  std::uint64_t frames_ = 0;  ///< number of frames so far in virtual time
  TripleBuffer<RecordingRow> latest_;
};

/// Returns how deep the tool presses the sheet to which the shape belongs, in the tick of this row:
/// the penetration if the tool is in contact with this sheet, otherwise 0.
double shape_depth_m(const RecordingRow& row, const SheetShape& shape) noexcept;

/// Writes frames as JSON lines. For each new shape there is a line
///   {"shape", "slice", "z_m", "cuts", "vertices_m": [[x, y], ...], "triangles", "w"},
/// and for each frame a line
///   {"t_s", "state", "tip_m", "wanted_z_N", "shape", "depth_m"}.
/// Shapes are numbered from 0. In the line of a shape, "cuts" is the number of holes in the sheet,
/// and "w" says how far each vertex follows the tool: w is 1 at the tool's outline and falls to 0
/// away from it. In a frame, "state" is the phase of contact, "wanted_z_N" is the z component of the
/// wanted force, and "shape" is the number of the latest shape, or null if there is none yet.
/// Vertex i of the latest shape is at the height z_m - depth_m w[i].
class FrameWriter {
 public:
  explicit FrameWriter(std::filesystem::path file) : file_(std::move(file)) {}

  /// Adds a frame. `shape` may be null.
  void add(const RecordingRow& row, const std::shared_ptr<const SheetShape>& shape);
  /// Writes all lines to the file, atomically.
  Result<void> finish() const;

 private:
  std::filesystem::path file_;
  std::string text_;
  std::shared_ptr<const SheetShape> last_;
  int shapes_ = 0;
};

// Converts the meshes of sheets to the form in which other processes read them
// (formats/session/telemetry.md).

/// The mesh of a sheet before its first hole. Later versions of the sheet get their HU from this
/// first mesh. When a hole is cut, vertices are added for which the asset has no HU. Their HU is
/// interpolated in the first mesh.
class FirstSheet {
 public:
  explicit FirstSheet(const Sheet& sheet);

  bool has_hu() const noexcept { return hu_ != nullptr; }
  /// Converts this sheet with the holes that it has now. If has_hu() is true, the result has the HU
  /// of all vertices.
  TelemetrySheet published(const Sheet& sheet) const;

 private:
  float hu_at(LatticePoint point) const;

  SheetMesh mesh_;
  TriangleGrid grid_;
  std::shared_ptr<const std::vector<float>> hu_;  ///< one HU for each vertex of mesh_; null: none
};

// The facts that do not change during a session, such as its scene, device, rate and limits. They
// are written as JSON into the session's shared memory, for the programs that read this memory
// (formats/session/telemetry.md, section About).

struct SessionOptions;

/// The limits of a live hand, which is a hand that a person moves (live_hand.h).
struct LiveHandLimits {
  Pose T_device_tool_start;  ///< target pose of the tip when the session begins
  /// Box of tip positions in {B}. With the tool's rotation at the start, the device reaches every
  /// position in the box and 5 mm more on each side. The box is at least 20 mm wide. It extends at
  /// least 20 mm below the lowest slice, unless no such box reaches so far.
  Eigen::Vector3d min_m = Eigen::Vector3d::Zero(), max_m = Eigen::Vector3d::Zero();
  double turn_max_rad = 0;  ///< largest angle from the rotation at the start
  /// speed_max_m_per_s: largest speed of the target while the person holds the hand. Contract 4
  /// states the largest speed after the person has let go. rotation_rate_max_rad_per_s: largest
  /// rotation rate of the target at all times.
  double speed_max_m_per_s = 0.15, rotation_rate_max_rad_per_s = 1;
};

/// A live hand: its limits, and the springs that pull the tip to the target.
struct PublishedHand {
  LiveHandLimits limits;
  HandImpedance impedance;
};

/// Facts that the program supplies.
struct TelemetryOptions {
  std::filesystem::path file;  ///< name of the link to the shared memory
  /// `device` and `recovery` are the values of the options --device and --recover. In a replay,
  /// `device` is "replay".
  std::string scene_file, device, recovery;
  std::vector<std::string> tissue_of_sheet;  ///< tissue names, topmost sheet first; "": no name
  std::optional<PublishedHand> hand = {};    ///< none: the session has no live hand
};

/// Returns the facts as JSON text. Precondition: options.telemetry is set.
std::string session_facts(const Scene& scene, const DeviceSpecification& device,
                          const Remesher& remesher, const SessionOptions& options);

// A snapshot holds numbers of the latest tick for other processes, in the columns of
// formats/session/telemetry.md. To add a value, add a line to the table in session_publisher.cpp.

/// Values of a tick that the haptic thread passes to the thread that writes snapshots. All counts
/// begin with 0 at the start of the session.
struct TelemetryTick {
  RecordingRow row;
  /// Start of the tick, on CLOCK_MONOTONIC. In a pause there are no ticks; then it is the time at
  /// which the loop last woke.
  std::int64_t taken_ns = 0;
  DeviceReadout readout;
  std::int32_t active_sheet = -1;  ///< index of a sheet (ContactOutput::active_sheet); -1: none
  std::uint64_t ticks = 0, missed_deadlines = 0, punctures = 0, faults = 0;
  std::uint64_t break_throughs = 0;
  LateTicks::Counts late_ticks{};  ///< missed deadlines that each part of the tick has caused
  std::int64_t late_max_ns = 0;    ///< longest delay of the haptic thread's wake-up so far
  std::uint64_t xray_shots = 0;
  double xray_screening_s = 0;
  /// Sheets that have been in contact, and sheets that have been punctured. Bit i: sheet i.
  std::uint64_t sheets_touched = 0, sheets_punctured = 0;
  std::array<std::uint32_t, kMaxSceneSlices> sheet_cuts{};  ///< number of holes in each sheet
  bool is_paused = false, has_ended = false;
};
static_assert(kMaxSceneSlices <= kMaxTelemetrySheets && kMaxSceneSlices <= 64);

// Publishes a running session in shared memory that other processes read, and receives commands
// from these processes (formats/session/telemetry.md). The haptic thread writes the latest tick
// into a triple buffer, and pushes events into a queue. A second thread copies tick and events to
// the shared memory. A third thread, the remesher's, writes the sheets to the shared memory.

/// The commands that other processes have given since the last call of take_commands().
struct TelemetryCommands {
  bool stop = false, pause = false, resume = false, zero = false, recover = false,
       emergency_stop = false;
  std::uint64_t xray_shots = 0;  ///< number of X-ray pictures requested
  std::uint64_t screening = 0;   ///< counter, odd while screening is requested (TelemetryWriter)
};

class SessionPublisher final : public TickObserver {
 public:
  /// Creates the shared memory, writes the uncut sheets into it, and then creates the link by which
  /// other processes find the memory. `prefetch`: the worker of the force law; may be null.
  /// `recorder`: writes the recording and outlives the publisher; null: no recording. Precondition:
  /// options.telemetry is set. Errors: those of TelemetryWriter::make() and TelemetryWriter::link().
  static Result<std::unique_ptr<SessionPublisher>> make(
      const Scene& scene, const DeviceSpecification& device, const Remesher& remesher,
      const PrefetchWorker* prefetch, const SessionOptions& options, const Recorder* recorder);
  ~SessionPublisher() override { stop(); }

  // The haptic thread calls these functions.

  TelemetryCommands take_commands() noexcept;
  /// Tries once to read the message of the live hand. If there is no complete message, leaves
  /// `hand` unchanged.
  void read_hand(TelemetryHand& hand) const noexcept { writer_->hand(hand); }
  void on_puncture(const PunctureEvent& puncture) noexcept override;
  void on_break_through(const BreakThroughEvent& found) noexcept override;
  void on_message(const OperatorMessage& message) noexcept override;
  void on_tick(const TickView& tick) noexcept override;
  /// Call this once in each period of a pause, instead of on_tick().
  void on_paused_period(std::int64_t now_ns) noexcept;
  /// Pushes an event that has no data except its time. If the queue is full, the event is lost;
  /// readers get the number of lost events.
  void push_event(TelemetryEventKind kind, double t_s) noexcept;

  // The remesher's thread calls this function. In virtual time, the session's thread calls it.

  /// Writes each sheet that has got new holes since the last call.
  void publish_sheets(const Remesher& remesher);

  /// TickObserver says which thread calls this function.
  void serve() override;

  /// Call this after the haptic thread and the remesher's thread have ended. Writes the last
  /// meshes, the event kEnded, and the last snapshot.
  void end(TelemetryEnd end, Fault fault, const Remesher& remesher);

 private:
  SessionPublisher();
  void push(const TelemetryEvent& event) noexcept;
  void count_xray(const RecordingRow& row) noexcept;
  /// If X-ray screening was on, pushes the event that it has ended. Called in a pause and
  /// at the end.
  void end_screening() noexcept;
  void publish_shape();
  void write(const TelemetryTick& tick);

  SpscQueue<TelemetryEvent, 1024> events_;
  SpscQueue<TelemetryEvent, 1024> sheet_events_;  ///< events that publish_sheets() pushes
  TripleBuffer<TelemetryTick> ticks_;
  TelemetryTick tick_;  ///< latest tick, for the haptic thread only
  XrayUse xray_;
  double rate_Hz_ = 0;
  TelemetryHistogram tick_times_, wake_times_;
  std::atomic<std::uint64_t> lost_events_{0};
  std::array<std::uint64_t, kTelemetryCommands> taken_{};
  std::unique_ptr<TelemetryWriter> writer_;
  const PrefetchWorker* prefetch_ = nullptr;
  const Recorder* recorder_ = nullptr;
  Tool tool_;
  std::vector<FirstSheet> first_;
  std::vector<std::int32_t> slices_;
  std::vector<std::int64_t> published_cuts_;  ///< holes in each written sheet; -1: not written yet
  std::atomic<double> last_t_s_{0};
  std::shared_ptr<const SheetShape> shape_;
  std::uint64_t shapes_ = 0;
  std::vector<double> values_;
};

}  // namespace trocar::runtime
