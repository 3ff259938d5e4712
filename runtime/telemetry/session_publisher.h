// SPDX-License-Identifier: Apache-2.0
// Publishes a running session in memory that other processes read, and takes their commands
// (formats/session/telemetry.md). The haptic thread writes the latest tick into a triple buffer and
// pushes events into a queue; another thread copies both to the memory. The thread that publishes
// meshes writes the sheets.
// Tests: tests/runtime/session/live_session_test.cpp
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/telemetry.h"
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

/// The commands of other processes that were given since they were last taken.
struct TelemetryCommands {
  bool stop = false, pause = false, resume = false, zero = false, recover = false,
       emergency_stop = false;
};

class SessionPublisher final : public TickObserver {
 public:
  /// Creates the memory, with the uncut sheets in it, and its link. `prefetch` may be null.
  /// Unwritable: there is no memory, or as TelemetryWriter::link().
  static Result<std::unique_ptr<SessionPublisher>> make(const Scene& scene,
                                                        const DeviceDescription& description,
                                                        const Remesher& remesher,
                                                        const PrefetchWorker* prefetch,
                                                        const TelemetryOptions& options,
                                                        const PublishedSession& session);
  ~SessionPublisher() override { stop(); }

  // Haptic thread.

  TelemetryCommands take_commands() noexcept;
  void on_puncture(const PunctureEvent& puncture) noexcept override;
  void on_message(const OperatorMessage& message) noexcept override;
  void on_tick(const TickView& tick) noexcept override;
  /// In place of a tick while the session is paused.
  void on_paused_period(std::int64_t now_ns) noexcept;
  /// kPaused or kResumed. Readers learn how many events a full queue has lost.
  void push_event(TelemetryEventKind kind, double t_s) noexcept;

  // The thread that publishes meshes.

  /// Writes the sheets whose published version has changed.
  void publish_sheets(const Remesher& remesher);

  // One other thread: the one that start() creates, or the caller's.

  void serve() override;

  // After all other threads have ended.

  /// Writes the last meshes, the event kEnded, and the last snapshot.
  void end(TelemetryEnd end, Fault fault, const Remesher& remesher);

 private:
  SessionPublisher();
  void push(const TelemetryEvent& event) noexcept;
  void publish_shape();
  void write(const TelemetryTick& tick);

  SpscQueue<TelemetryEvent, 1024> events_;
  SpscQueue<TelemetryEvent, 1024> sheet_events_;  ///< pushed by the thread that publishes meshes
  TripleBuffer<TelemetryTick> ticks_;
  TelemetryTick tick_;  ///< haptic thread: the latest
  TelemetryHistogram tick_times_, wake_times_;
  std::atomic<std::uint64_t> lost_events_{0};
  std::array<std::uint64_t, kTelemetryCommands> taken_{};
  std::unique_ptr<TelemetryWriter> writer_;
  const PrefetchWorker* prefetch_ = nullptr;
  DeviceDescription description_;
  MotorModel motor_;
  Tool tool_;
  std::vector<FirstSheet> first_;
  std::vector<std::int32_t> slices_;
  std::vector<std::int64_t> published_cuts_;  ///< -1: not published yet
  std::atomic<double> last_t_s_{0};
  std::shared_ptr<const SheetShape> shape_;
  std::uint64_t shapes_ = 0;
  std::vector<double> values_;
};

}  // namespace trocar::runtime
