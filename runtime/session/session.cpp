// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/session.h"

#include <memory>
#include <utility>

#include "runtime/realtime/allocation_counter.h"
#include "runtime/session/session_clock.h"
#include "runtime/session/session_loop.h"

namespace trocar::runtime {

SessionResult run_session(const Scene& scene, Remesher& remesher, HandDevice& device,
                          const std::function<void(double dt_s)>& advance,
                          const SessionOptions& options, SessionWorkers workers) {
  const auto clock = make_clock(options, remesher, workers.law->prefetch_worker());
  const auto loop =
      std::make_unique<SessionLoop>(scene, remesher, device, advance, options, workers, *clock);
  const std::uint64_t allocations_before = allocations_in_scopes();
  RealtimeReport realtime = clock->run(*loop);
  SessionResult report = loop->finish();
  report.realtime = std::move(realtime);
  if (workers.publisher) workers.publisher->end(report.end, report.fault, remesher);
  if (allocations_are_counted())
    report.allocations_in_loop = allocations_in_scopes() - allocations_before;
  if (workers.black_box) {
    report.black_boxes = workers.black_box->files();
    report.black_boxes_lost = workers.black_box->lost();
  }
  if (workers.tick_feed) report.ticks_not_observed = workers.tick_feed->lost();
  report.law = workers.law;
  if (workers.recorder) {
    if (Result<void> written = workers.recorder->finish(); !written)
      report.recording_error = written.error();
  }
  return report;
}

Result<SessionResult> run_session(const Scene& scene, Remesher& remesher, HandDevice& device,
                                  const std::function<void(double dt_s)>& advance,
                                  const SessionOptions& options) {
  Result<SessionWorkers> workers = make_workers(scene, device.specification(), remesher, options);
  if (!workers) return workers.error();
  return run_session(scene, remesher, device, advance, options, std::move(*workers));
}

}  // namespace trocar::runtime
