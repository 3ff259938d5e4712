// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/session.h"

#include <charconv>
#include <deque>

#include "runtime/session/force_law_table.h"

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
      if (loop.is_paused())
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      else
        after_tick(loop.ticks_done(), loop.contact());
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

Result<std::unique_ptr<ForceLaw>> make_law(const Scene& scene, const DeviceSpecification& device,
                                           const Remesher& remesher,
                                           const SessionOptions& options) {
  std::vector<const Sheet*> sheets;
  for (std::size_t i = 0; i < remesher.size(); ++i)
    sheets.push_back(&remesher.first_version(i));
  return make_force_law(
      {scene, device, sheets, options.rate_Hz, options.coupling, options.stiffness});
}

std::string text_of(const PoseEstimator& estimator) {
  std::string text;
  for (const AxisEstimator* axis : {&estimator.translation, &estimator.rotation})
    text += (text.empty() ? "" : "/") + origin_number(axis->bandwidth_per_s) + '/' +
            origin_number(axis->lead_s);
  return text;
}

/// The estimator that an origin states, which is not trusted.
std::optional<PoseEstimator> read_estimator(const std::string& text) {
  PoseEstimator out;
  const char *at = text.data(), *const end = at + text.size();
  for (AxisEstimator* axis : {&out.translation, &out.rotation}) {
    for (double* value : {&axis->bandwidth_per_s, &axis->lead_s}) {
      const auto [stop, error] = std::from_chars(at, end, *value);
      const bool is_last = value == &out.rotation.lead_s;
      if (error != std::errc() || (is_last ? stop != end : stop == end || *stop != '/'))
        return std::nullopt;
      at = is_last ? end : stop + 1;
    }
    if (!(axis->bandwidth_per_s > 0 && axis->lead_s >= 0 && axis->lead_s <= 1)) return std::nullopt;
  }
  return out;
}

/// The session's estimator: the one of a recording that is replayed, so that it has the same bits,
/// or the law's, which is put into an origin that states anything.
Result<PoseEstimator> session_estimator(const ForceLaw& law, RecordingOrigin& origin) {
  if (const std::string* const stated = origin.find(kOriginEstimator)) {
    const auto read = read_estimator(*stated);
    if (!read) return refused("the recording states no estimator: " + *stated);
    return *read;
  }
  if (!origin.entries.empty())
    origin.entries.emplace_back(kOriginEstimator, text_of(law.estimator()));
  return law.estimator();
}

/// Speeds that noise, or a motion of two steps of the readings in a tick, can show.
void set_guard_bands(const DeviceSpecification& device, LoopModel& model) {
  constexpr double kSigmas = 5, kSteps = 2, kWaySteps = 3;
  const DeviceReadings of = device.readings();
  const double period_s = 1 / model.rate_Hz;
  const auto band = [&](const AxisEstimator& estimator, double noise, double resolution) {
    const PlateAxis axis{.noise_m = noise, .resolution_m = resolution};
    return kSigmas * speed_noise(estimator, period_s, axis) +
           kSteps * resolution * filter_gains(estimator.bandwidth_per_s, period_s).beta / period_s;
  };
  model.band_m_per_s =
      std::max(model.band_m_per_s, band(model.estimator.translation, of.noise_m, of.resolution_m));
  model.band_rad_per_s = std::max(model.band_rad_per_s,
                                  band(model.estimator.rotation, of.noise_rad, of.resolution_rad));
  model.way_m = kWaySteps * of.resolution_m;
  model.way_rad = kWaySteps * of.resolution_rad;
}

}  // namespace

std::unique_ptr<SessionClock> make_clock(const SessionOptions& options, Remesher& remesher,
                                         PrefetchWorker* prefetch) {
  if (!options.replay.empty()) return std::make_unique<ReplayClock>(options, remesher);
  if (options.clock == Clock::kVirtual)
    return std::make_unique<VirtualClock>(options, remesher, prefetch);
  return std::make_unique<RealClock>(options, remesher, prefetch);
}

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
  if (const auto ok = make_law(scene, device, remesher, options).into(workers.law); !ok)
    return ok.error();
  RecordingOrigin origin = options.origin;
  if (const auto ok = session_estimator(*workers.law, origin).into(workers.estimator); !ok)
    return ok.error();
  if (options.record) {
    auto made = Recorder::make(*options.record, origin, options.rate_Hz, options.on_low_space);
    if (!made) return made.error();
    workers.recorder = std::move(*made);
  }
  if (options.black_box) {
    auto made = BlackBox::make(*options.black_box, options.rate_Hz, origin);
    if (!made) return made.error();
    workers.black_box = std::move(*made);
  }
  const PrefetchWorker* const prefetch = workers.law->prefetch_worker();
  if (options.on_message) workers.messages = std::make_unique<OperatorMessages>(options.on_message);
  if (options.on_frame)
    workers.frames =
        std::make_unique<FrameDisplay>(options.on_frame, options.frame_rate_Hz,
                                       options.is_real_time() ? 0 : options.rate_Hz, prefetch);
  if (options.on_tick) workers.tick_feed = std::make_unique<TickFeed>(options.on_tick);
  if (options.telemetry) {
    auto made =
        SessionPublisher::make(scene, device, remesher, prefetch, options, workers.recorder.get());
    if (!made) return made.error();
    workers.publisher = std::move(*made);
  }
  return workers;
}

SessionLoop::SessionLoop(const Scene& scene, Remesher& remesher, HandDevice& device,
                         const std::function<void(double)>& advance, const SessionOptions& options,
                         const SessionWorkers& workers, SessionClock& clock)
    : model_{.tool = make_tool(scene.tool),
             .limits = options.limits,
             .estimator = workers.estimator,
             .guards = options.guards,
             .compensation = options.compensation,
             .rate_Hz = options.rate_Hz},
      remesher_(remesher),
      device_(device),
      law_(*workers.law),
      advance_(advance),
      options_(options),
      clock_(clock),
      recorder_(workers.recorder.get()),
      publisher_(workers.publisher.get()),
      commands_(options.recovery, options.recover),
      statistics_(options.replay),
      observers_(workers.observers()),
      sheets_(remesher.size()) {
  set_guard_bands(device.specification(), model_);
  observers_.insert(observers_.end(), options.observers.begin(), options.observers.end());
  observers_.push_back(&statistics_);
  state_.safety.recovered = model_.limits.timing.ramps_at_start;
}

bool SessionLoop::tick(const TickTiming& timing) noexcept {
  const NoAllocationScope scope;
  if (state_.tick == clock_.ticks()) return false;
  const std::int64_t start_ns = monotonic_ns();
  TelemetryCommands given;
  if (publisher_ != nullptr) given = publisher_->take_commands();
  if (given.stop) return false;
  if (options_.suspension != nullptr) given.pause |= options_.suspension->is_requested.load();
  commands_.apply(given, state_.safety.fault);
  receive_hand(start_ns);
  const bool is_paused = pauses(start_ns);
  xray_.apply(given, is_paused, start_ns);
  if (is_paused) return !recording_has_failed();
  const std::uint64_t versions = remesher_.versions_published();
  for (std::size_t i = 0; i < sheets_.size(); ++i)
    sheets_[i] = remesher_.current(i, versions);
  late_ticks_.begin(timing, 1e9 / model_.rate_Hz);
  haptic_tick(model_, inputs(timing), device_, law_, state_, result_);
  if (result_.end_of_data) return false;
  result_.row.cuts_published = static_cast<std::int64_t>(versions);
  result_.row.xray = xray_of_tick();
  for (const CutRequest& cut : result_.contact.cuts())
    request_hole(cut);
  last_hand_N_ = Eigen::Vector3d(result_.row.wrench_delivered.data()).norm();
  clock_.prefetch(result_.contact.prefetch);
  for (const OperatorMessage& message : messages_.update(result_)) {
    for (TickObserver* observer : observers_)
      observer->on_message(message);
  }
  if (const auto& found = result_.break_through.found) {
    const RecordingRow& row = result_.row;
    const BreakThroughEvent event{found->sheet, row.break_through_at, row.t_s, row.tool_m[2],
                                  row.break_through_N};
    for (TickObserver* observer : observers_)
      observer->on_break_through(event);
  }
  const TickView view{
      result_, state_, sheets_, timing, late_ticks_.counts(), options_.is_real_time(), start_ns};
  for (TickObserver* observer : observers_)
    observer->on_tick(view);
  const std::int64_t done_ns = monotonic_ns();
  statistics_.add_tick_time(done_ns - start_ns, result_.device_ns);
  late_ticks_.spend(TickPart::kLaw, result_.law_ns);
  late_ticks_.spend(TickPart::kPublishing, done_ns - start_ns - result_.law_ns - result_.device_ns);
  advance_(1 / model_.rate_Hz);
  late_ticks_.spend(TickPart::kDevice, result_.device_ns + (monotonic_ns() - done_ns));
  return goes_on();
}

/// Returns RecordingRow::xray of this tick. state_.tick counts it already.
std::uint8_t SessionLoop::xray_of_tick() noexcept {
  if (!options_.counts_xray) return 0;
  const RecordingRow* const recorded = clock_.recorded(state_.tick - 1);
  return recorded != nullptr ? recorded->xray : xray_.take();
}

void SessionLoop::receive_hand(std::int64_t now_ns) noexcept {
  if (options_.hand == nullptr || publisher_ == nullptr) return;
  publisher_->read_hand(hand_);
  if (const auto change = options_.hand->receive(hand_, now_ns))
    publisher_->push_event(*change, result_.row.t_s);
}

/// Returns true if time is paused in this period: the operator has paused the session, and torques
/// are zero after a tick that has seen the pause. A drive with a clock of its own meanwhile gets
/// zero torques, because its watchdog waits for commands. If the device's own emergency stop is
/// pressed meanwhile, the first tick after the pause latches kEmergencyStop, even if the stop has
/// been released by then.
bool SessionLoop::pauses(std::int64_t now_ns) noexcept {
  const bool is_replay = clock_.recorded(state_.tick) != nullptr;
  const bool was_paused =
      std::exchange(is_paused_, commands_.is_paused() && (result_.torques_are_zero || is_replay));
  if (publisher_ != nullptr && is_paused_ != was_paused)
    publisher_->push_event(is_paused_ ? TelemetryEventKind::kPaused : TelemetryEventKind::kResumed,
                           result_.row.t_s);
  if (!is_paused_) {
    if (was_paused && options_.hand != nullptr) options_.hand->restart_at_tip();
    return false;
  }
  if (!is_replay && !device_.is_paced_by_loop()) {
    double ignored_t_s = 0;
    // The zero torques of a pause acknowledge the device's own stop, so the drive forgets it.
    const bool is_pressed = device_.read(ignored_t_s) == DeviceStatus::kEmergencyStop;
    if (is_pressed && !state_.safety.stops.is_device_held()) outside_ = Fault::kEmergencyStop;
    device_.use_last_reading();
    device_.write_zero();
  }
  if (options_.suspension != nullptr)
    options_.suspension->paused_periods.fetch_add(1, std::memory_order_relaxed);
  if (publisher_ != nullptr) publisher_->on_paused_period(now_ns);
  return true;
}

TickInputs SessionLoop::inputs(const TickTiming& timing) noexcept {
  TickInputs inputs;
  inputs.sheets = sheets_;
  inputs.prefetched = clock_.stiffness();
  if (const RecordingRow* recorded = clock_.recorded(state_.tick)) {
    inputs.outside = recorded->outside_fault;
    if (recorded->recovery_asked != 0) inputs.recover = RecoveryRequest::kByOperator;
    return inputs;
  }
  inputs.gap_s = timing.gap_s;
  inputs.missed_in_row = timing.missed_in_row;
  inputs.outside = std::exchange(outside_, Fault::kNone);
  if (const Fault latched = commands_.latched_fault();
      latched != Fault::kNone && inputs.outside != Fault::kEmergencyStop)
    inputs.outside = latched;
  is_ending_ = is_ending_ || recording_has_failed();
  if (is_ending_ && inputs.outside != Fault::kEmergencyStop)
    inputs.outside = Fault::kRecordingFailed;
  if (!is_ending_) inputs.recover = commands_.request();
  return inputs;
}

void SessionLoop::request_hole(const CutRequest& cut) noexcept {
  if (!remesher_.request(cut)) outside_ = Fault::kRemeshBacklog;
  if (!cut.is_puncture) return;
  PunctureEvent event{.sheet = cut.sheet,
                      .slice = sheets_[cut.sheet]->slice_index,
                      .cut = cut.cut,
                      .t_s = result_.row.t_s};
  event.tool_z_m = result_.row.tool_m[2];  // as in the recording, from which reports are made
  event.penetration_m = result_.contact.penetration_m;
  event.tip_N = result_.contact.force_before_N;
  event.hand_N = last_hand_N_;
  event.trial_force_N = result_.contact.trial_force_N;
  for (TickObserver* observer : observers_)
    observer->on_puncture(event);
}

bool SessionLoop::recording_has_failed() const noexcept {
  return recorder_ != nullptr && recorder_->has_failed();
}

bool SessionLoop::goes_on() const noexcept {
  // A replay has no forces that would have to be ramped down.
  if (!options_.replay.empty() && recording_has_failed()) return false;
  if (is_ending_) {
    const SafetyState state = state_.safety.state;
    return state == SafetyState::kRunning ||
           (state == SafetyState::kFault && !result_.torques_are_zero);
  }
  return !result_.torques_are_zero || options_.recovery != RecoveryPolicy::kNever ||
         !options_.replay.empty() || commands_.waits_for_operator(state_.safety.fault);
}

void SessionLoop::publish_sheets() {
  if (publisher_ != nullptr) publisher_->publish_sheets(remesher_);
}

void SessionLoop::start_observers() {
  for (TickObserver* observer : observers_)
    observer->start();
}

void SessionLoop::serve_observers() {
  for (TickObserver* observer : observers_)
    observer->serve();
}

SessionResult SessionLoop::finish() {
  for (TickObserver* observer : observers_)
    observer->stop();
  // A recording may have fewer ticks than its session was to have.
  const std::uint64_t all_ticks = tick_count(options_.duration_s, options_.rate_Hz);
  SessionResult report = statistics_.take(state_, state_.tick >= all_ticks);
  report.late_ticks = late_ticks_.counts();
  return report;
}

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
