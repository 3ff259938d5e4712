// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/session_workers.h"

#include <utility>

#include "runtime/force_law/force_law_table.h"

namespace trocar::runtime {
namespace {

std::string clock_name(const SessionOptions& options) {
  if (!options.replay.empty()) return "replay";
  return options.clock == Clock::kReal ? "real" : "virtual";
}

Result<std::unique_ptr<ForceLaw>> make_law(const Scene& scene, const DeviceSpecification& device,
                                           const Remesher& remesher,
                                           const SessionOptions& options) {
  std::vector<const Sheet*> sheets;
  for (std::size_t i = 0; i < remesher.size(); ++i)
    sheets.push_back(&remesher.first_version(i));
  return make_force_law(
      {scene, device, sheets, options.rate_Hz, options.coupling, options.stiffness});
}

}  // namespace

std::vector<TickObserver*> SessionWorkers::observers() const {
  std::vector<TickObserver*> all;
  for (TickObserver* observer :
       std::initializer_list<TickObserver*>{recorder.get(), black_box.get(), messages.get(),
                                            frames.get(), publisher.get(), tick_feed.get()}) {
    if (observer != nullptr) all.push_back(observer);
  }
  return all;
}

Result<SessionWorkers> make_workers(const Scene& scene, const DeviceSpecification& device,
                                    const Remesher& remesher, const SessionOptions& options) {
  SessionWorkers workers;
  if (options.record) {
    auto made =
        Recorder::make(*options.record, options.origin, options.rate_Hz, options.on_low_space);
    if (!made) return made.error();
    workers.recorder = std::move(*made);
  }
  if (options.black_box) {
    auto made = BlackBox::make(*options.black_box, options.rate_Hz, options.origin);
    if (!made) return made.error();
    workers.black_box = std::move(*made);
  }
  auto law = make_law(scene, device, remesher, options);
  if (!law) return law.error();
  workers.law = std::move(*law);
  const PrefetchWorker* const prefetch = workers.law->prefetch_worker();
  if (options.on_message) workers.messages = std::make_unique<OperatorMessages>(options.on_message);
  if (options.on_frame)
    workers.frames =
        std::make_unique<FrameDisplay>(options.on_frame, options.frame_rate_Hz,
                                       options.is_real_time() ? 0 : options.rate_Hz, prefetch);
  if (options.on_tick) workers.tick_feed = std::make_unique<TickFeed>(options.on_tick);
  if (options.telemetry) {
    auto made =
        SessionPublisher::make(scene, device, remesher, prefetch, *options.telemetry,
                               {.rate_Hz = options.rate_Hz,
                                .duration_s = options.duration_s,
                                .clock = clock_name(options),
                                .record = options.record,
                                .counts_xray = options.counts_xray && options.replay.empty(),
                                .limits = options.limits,
                                .recorder = workers.recorder.get()});
    if (!made) return made.error();
    workers.publisher = std::move(*made);
  }
  return workers;
}

}  // namespace trocar::runtime
