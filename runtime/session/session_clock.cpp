// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/session_clock.h"

#include <deque>

#include "runtime/session/session.h"

namespace trocar::runtime {
namespace {

/// Virtual clock: number of ticks from the request for a hole or for prefetched stiffness until the
/// result is used.
constexpr std::uint64_t kHandoverTicks = 8;
/// Virtual clock: period of the requests for prefetched stiffness.
constexpr double kPrefetchPeriod_s = 0.004;

class RealClock final : public SessionClock {
 public:
  RealClock(const SessionOptions& options, Remesher& remesher, PrefetchWorker* prefetch)
      : SessionClock(tick_count(options.duration_s, options.rate_Hz)),
        options_(options),
        remesher_(remesher),
        prefetch_(prefetch) {}

  const PrefetchedStiffness& stiffness() noexcept override {
    if (prefetch_ != nullptr) prefetch_->latest(stiffness_);
    return stiffness_;
  }
  void prefetch(const PrefetchRequest& request) noexcept override {
    if (prefetch_ != nullptr) prefetch_->ask(request);
  }

  RealtimeReport run(SessionLoop& loop) override {
    keep_off(options_.cpu);
    loop.start_observers();
    remesher_.start([this, &loop] {
      loop.publish_sheets();
      if (prefetch_ == nullptr) return;
      prefetch_->serve([this](std::size_t i) -> const Sheet& { return remesher_.last_version(i); });
    });
    RealtimeReport report = run_realtime(
        options_.realtime(), [&loop](const TickTiming& timing) { return loop.tick(timing); },
        [&loop] { loop.write_zero_torques(); });
    remesher_.stop();
    return report;
  }

 private:
  const SessionOptions& options_;
  Remesher& remesher_;
  PrefetchWorker* prefetch_;
};

/// Ticks follow each other without a pause. A derived class decides when the workers' results
/// come into use.
class ImmediateClock : public SessionClock {
 public:
  ImmediateClock(std::uint64_t ticks, const SessionOptions& options, Remesher& remesher)
      : SessionClock(ticks), options_(options), remesher_(remesher) {}

  RealtimeReport run(SessionLoop& loop) final {
    hand_over(loop.ticks_done());
    while (!options_.is_stopped() && loop.tick({})) {
      if (loop.is_paused()) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      } else {
        after_tick(loop.ticks_done(), loop.contact());
      }
      hand_over(loop.ticks_done());
      loop.publish_sheets();
      loop.serve_observers();
    }
    loop.write_zero_torques();
    remesher_.stop();
    return {};
  }

 protected:
  /// Called after a tick. `ticks_done`: number of ticks so far, which is also the index of
  /// the next tick.
  virtual void after_tick(std::uint64_t ticks_done, const ContactOutput& contact) = 0;
  /// Called before a tick. Puts the results that are due into use.
  virtual void hand_over(std::uint64_t next_tick) = 0;

  const SessionOptions& options_;
  Remesher& remesher_;
};

class VirtualClock final : public ImmediateClock {
 public:
  VirtualClock(const SessionOptions& options, Remesher& remesher, PrefetchWorker* prefetch)
      : ImmediateClock(tick_count(options.duration_s, options.rate_Hz), options, remesher),
        prefetch_(prefetch),
        prefetch_period_(static_cast<std::uint64_t>(
            std::max(1.0, std::round(kPrefetchPeriod_s * options.rate_Hz)))) {}

 private:
  void after_tick(std::uint64_t ticks_done, const ContactOutput& contact) override {
    const std::uint64_t due = ticks_done - 1 + kHandoverTicks;
    meshes_due_.insert(meshes_due_.end(), contact.cuts().size(), due);
    remesher_.serve();
    const PrefetchRequest& request = contact.prefetch;
    if (prefetch_ == nullptr || ticks_done % prefetch_period_ != 0 || request.sheet < 0) return;
    const Sheet& sheet = remesher_.last_version(static_cast<std::size_t>(request.sheet));
    if (const auto found = prefetch_->answer(request, sheet))
      stiffness_due_.emplace_back(due, *found);
  }

  void hand_over(std::uint64_t next_tick) override {
    while (!meshes_due_.empty() && meshes_due_.front() <= next_tick) {
      meshes_due_.pop_front();
      remesher_.publish_next();
    }
    while (!stiffness_due_.empty() && stiffness_due_.front().first <= next_tick) {
      stiffness_ = stiffness_due_.front().second;
      stiffness_due_.pop_front();
    }
  }

  PrefetchWorker* prefetch_;
  std::uint64_t prefetch_period_;         ///< period of requests, in ticks
  std::deque<std::uint64_t> meshes_due_;  ///< ticks from which on the next meshes are used
  std::deque<std::pair<std::uint64_t, PrefetchedStiffness>> stiffness_due_;
};

class ReplayClock final : public ImmediateClock {
 public:
  ReplayClock(const SessionOptions& options, Remesher& remesher)
      : ImmediateClock(options.replay.size(), options, remesher) {}

  const RecordingRow* recorded(std::uint64_t tick) const noexcept override {
    return &options_.replay[tick];
  }

 private:
  void after_tick(std::uint64_t, const ContactOutput&) override { remesher_.serve(); }

  void hand_over(std::uint64_t next_tick) override {
    if (next_tick >= options_.replay.size()) return;
    const RecordingRow& row = options_.replay[next_tick];
    stiffness_ = {row.response_sheet, row.response_stiffness_N_per_m, row.response_offset_m};
    while (published_ < row.cuts_published && remesher_.publish_next())
      ++published_;
  }

  std::int64_t published_ = 0;
};

}  // namespace

std::unique_ptr<SessionClock> make_clock(const SessionOptions& options, Remesher& remesher,
                                         PrefetchWorker* prefetch) {
  if (!options.replay.empty()) return std::make_unique<ReplayClock>(options, remesher);
  if (options.clock == Clock::kVirtual)
    return std::make_unique<VirtualClock>(options, remesher, prefetch);
  return std::make_unique<RealClock>(options, remesher, prefetch);
}

}  // namespace trocar::runtime
