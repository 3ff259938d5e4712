// SPDX-License-Identifier: Apache-2.0
// Publishes a running session in shared memory that other processes read, and receives commands
// from these processes (formats/session/telemetry.md). The haptic thread writes the latest tick
// into a triple buffer, and pushes events into a queue. A second thread copies tick and events to
// the shared memory. A third thread, the remesher's, writes the sheets to the shared memory.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/telemetry.h"
#include "formats/session/xray_use.h"
#include "runtime/contact/prefetch_worker.h"
#include "runtime/realtime/spsc_queue.h"
#include "runtime/realtime/triple_buffer.h"
#include "runtime/telemetry/published_sheets.h"
#include "runtime/telemetry/session_facts.h"
#include "runtime/telemetry/snapshot.h"
#include "runtime/telemetry/telemetry_histogram.h"
#include "runtime/telemetry/tick_observer.h"
#include "runtime/workers/remesher.h"

namespace trocar::runtime {

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
  /// other processes find the memory. `prefetch`: the worker of the force law; may be null. Errors:
  /// those of TelemetryWriter::make() and TelemetryWriter::link().
  static Result<std::unique_ptr<SessionPublisher>> make(const Scene& scene,
                                                        const DeviceSpecification& device,
                                                        const Remesher& remesher,
                                                        const PrefetchWorker* prefetch,
                                                        const TelemetryOptions& options,
                                                        const PublishedSession& session);
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
