// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/session.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <deque>
#include <limits>
#include <numbers>
#include <thread>
#include <utility>

#include "runtime/realtime/allocation_counter.h"

namespace trocar::runtime {
namespace {

constexpr std::size_t kMaxListedPunctures = 4096;
constexpr double kCharacteristicLength_m = 0.05;

std::int64_t now_ns() noexcept {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * std::int64_t{1'000'000'000} + now.tv_nsec;
}

double wrench_norm(const std::array<double, 6>& w) noexcept {
  double sum = 0;
  for (int i = 0; i < 3; ++i)
    sum += w[i] * w[i];
  for (int i = 3; i < 6; ++i)
    sum += w[i] * w[i] / (kCharacteristicLength_m * kCharacteristicLength_m);
  return std::sqrt(sum);
}

bool same_bits(const std::array<double, 8>& a, const std::array<double, 8>& b) noexcept {
  return std::equal(a.begin(), a.end(), b.begin(), [](double x, double y) {
    return std::bit_cast<std::uint64_t>(x) == std::bit_cast<std::uint64_t>(y);
  });
}

constexpr bool is_by_operator(Fault fault) noexcept {
  return fault == Fault::kPaused || fault == Fault::kForcesOff;
}

class SessionLoop {
 public:
  SessionLoop(const Scene& scene, const DeviceDescription& description, Remesher& remesher,
              Device& device, const std::function<void(double)>& advance,
              const SessionOptions& options, const SessionWorkers& workers)
      : notices_(options.on_notice),
        remesher_(remesher),
        responder_(workers.responder.get()),
        device_(device),
        advance_(advance),
        options_(options),
        recorder_(workers.recorder.get()),
        black_box_(workers.black_box.get()),
        live_(workers.live.get()),
        tick_feed_(workers.tick_feed.get()),
        ticks_(options.replay.empty() ? tick_count(options.duration_s, options.rate_Hz)
                                      : options.replay.size()) {
    model_.device = description;
    model_.contact.tool = make_tool(scene.tool);
    model_.contact.dt_s = 1 / options.rate_Hz;
    model_.contact.law = scene.force_law;
    model_.limits = options.limits;
    model_.passivity = options.passivity;
    model_.coupling = options.coupling;
    model_.compensation = options.compensation;
    model_.rate_Hz = options.rate_Hz;
    if (workers.body) {
      model_.body = workers.body->body;
      model_.predicts = workers.body->coupling.predicts;
      model_.force_scale = scene.force_law.force_scale;
      state_.body = make_body_state(*model_.body);
      report_.cutting.emplace();
      report_.cutting->coupling = workers.body->coupling;
      report_.cutting->force_scale = model_.force_scale;
    }
    sheets_.resize(remesher.size());
    report_.punctures.reserve(kMaxListedPunctures);
    report_.faults.reserve(kMaxListedFaults);
  }

  /// One call of the haptic thread. False: the session is over.
  bool tick(const TickTiming& timing) noexcept {
    const NoAllocationScope scope;
    if (state_.tick == ticks_) return false;
    const std::int64_t start_ns = now_ns();
    if (live_ != nullptr) {
      if (live_->takes(LiveCommand::kStop)) return false;
      take_commands();
      if (stands_still(start_ns)) return true;
    }
    cuts_published_ = 0;
    seen_.punctured = seen_.side_cut = 0;
    for (std::size_t i = 0; i < sheets_.size(); ++i) {
      sheets_[i] = remesher_.current(i);
      cuts_published_ += sheets_[i]->cuts;
    }
    if (responder_ != nullptr && is_real()) responder_->latest(response_);
    haptic_tick(model_, inputs(timing), device_, state_, result_);
    if (result_.end_of_data) return false;
    result_.row.cuts_published = cuts_published_;
    for (const CutRequest& cut : result_.contact.cuts())
      request_cut(cut);
    if (responder_ != nullptr && is_real()) responder_->ask(result_.contact.ahead);
    if (recorder_ != nullptr) recorder_->push(result_.row);
    track_faults();
    if (options_.live != nullptr) options_.live->write(result_.row);
    if (options_.on_frame && is_real()) for_frames_.write(result_.row);
    update_report(result_.row);
    if (live_ != nullptr) show(timing, start_ns);
    if (options_.on_tick) see_tick();
    report_.tick.add(now_ns() - start_ns);
    advance_(model_.contact.dt_s);
    return !(result_.at_rest && options_.recovery == RecoveryPolicy::kNever &&
             options_.replay.empty() && !waits_for_operator());
  }

  void run_real() {
    keep_off(options_.cpu);
    if (live_ != nullptr) live_->start();
    remesher_.start([this] {
      if (live_ != nullptr) live_->show_sheets(remesher_);
      if (responder_ == nullptr) return;
      responder_->serve(
          [this](std::size_t i) -> const Sheet& { return remesher_.last_version(i); });
    });
    if (recorder_ != nullptr) recorder_->start();
    if (black_box_ != nullptr) black_box_->start();
    if (tick_feed_ != nullptr) tick_feed_->start();
    if (options_.on_notice) notices_.start();
    std::atomic<bool> done{false};
    std::thread display([this, &done] { show_frames(done); });
    RealtimeOptions realtime;
    realtime.rate_Hz = options_.rate_Hz;
    realtime.cpu = options_.cpu;
    realtime.stop = options_.stop;
    report_.realtime = run_realtime(
        realtime, [this](const TickTiming& timing) { return tick(timing); },
        [this] { write_zero_torques(); });
    done.store(true);
    display.join();
    if (tick_feed_ != nullptr) report_.ticks_not_seen = tick_feed_->finish();
    notices_.stop();
    remesher_.stop();
  }

  void run_virtual() {
    std::deque<std::uint64_t> due;  // ticks at whose start new meshes come into use
    std::size_t recorded = 0;
    for (;;) {
      if (options_.stop != nullptr && options_.stop->load()) break;
      publish_due(due);
      if (live_ != nullptr) {
        live_->show_sheets(remesher_);
        live_->serve();
      }
      has_seen_ = false;
      const bool goes_on = tick({});
      if (has_seen_) options_.on_tick(seen_);
      if (!goes_on) break;
      if (stands_) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        continue;
      }
      if (options_.on_notice) notices_.serve();
      if (black_box_ != nullptr) black_box_->serve();
      due.insert(due.end(), result_.contact.cuts().size(),
                 state_.tick - 1 + options_.handover_ticks);
      remesher_.serve();
      if (responder_ != nullptr && options_.replay.empty()) respond();
      if (options_.on_frame) show_frame();
      if (recorder_ != nullptr && ++recorded % (Recorder::kCapacity / 2) == 0) recorder_->drain();
    }
    write_zero_torques();
    notices_.stop();
    remesher_.stop();
  }

  SessionReport finish() {
    const Safety& safety = state_.safety;
    if (black_box_ != nullptr) {
      if (save_pending_)
        black_box_->save(safety.fault, safety.fault_t_s);  // the session ended within the ramp
      black_box_->stop();
      report_.black_boxes = black_box_->files();
      report_.black_boxes_lost = black_box_->lost();
    }
    report_.ticks = state_.tick;
    report_.fault = safety.fault;
    report_.fault_t_s = safety.fault_t_s;
    report_.energy_given_max_J = state_.passivity.given_max_J;
    if (report_.cutting) report_.cutting->ledger = state_.body.ledger;
    const bool has_failed = safety.fault != Fault::kNone && !is_by_operator(safety.fault);
    report_.end = has_failed              ? SessionEnd::kFault
                  : state_.tick == ticks_ ? SessionEnd::kDone
                                          : SessionEnd::kInterrupted;
    if (live_ != nullptr) show_end();
    return std::move(report_);
  }

 private:
  TickInputs inputs(const TickTiming& timing) noexcept {
    TickInputs inputs;
    inputs.sheets = sheets_;
    inputs.response = response_;
    if (!options_.replay.empty()) {
      if (state_.tick < options_.replay.size()) {
        inputs.outside = options_.replay[state_.tick].outside_fault;
        inputs.recover = options_.replay[state_.tick].recovery_asked != 0;
      }
      return inputs;
    }
    inputs.gap_s = timing.gap_s;
    inputs.missed_in_row = timing.missed_in_row;
    inputs.outside = std::exchange(outside_, Fault::kNone);
    if (const Fault held = held_fault(); held != Fault::kNone) inputs.outside = held;
    inputs.recover = result_.at_rest && wants_recovery();
    return inputs;
  }

  // The operator's commands. Pause, zero and emergency stop each hold until they are released, like
  // a pressed button: as long, their fault is found in every tick. So none gets lost while another
  // fault is latched, and no recovery ends before the release.

  void take_commands() noexcept {
    const bool signalled = options_.recovery == RecoveryPolicy::kOnRequest &&
                           options_.recover != nullptr && options_.recover->load();
    const bool recover = live_->takes(LiveCommand::kRecover);
    if (live_->takes(LiveCommand::kResume) && is_paused_) {
      is_paused_ = false;
      if (state_.safety.fault == Fault::kPaused) recovery_asked_ = true;
    }
    if (recover || (signalled && held_fault() != Fault::kNone)) {
      is_paused_ = is_off_ = is_stopped_ = false;
      recovery_asked_ = true;
    }
    const bool pause = live_->takes(LiveCommand::kPause), zero = live_->takes(LiveCommand::kZero);
    const bool stop = live_->takes(LiveCommand::kEmergencyStop);
    if (!pause && !zero && !stop) return;
    is_paused_ |= pause;
    is_off_ |= zero;
    is_stopped_ |= stop;
    forget_request();
  }

  void forget_request() noexcept {
    recovery_asked_ = false;
    if (options_.recover != nullptr) options_.recover->store(false);
  }

  /// That the operator wants to be found in each tick.
  Fault held_fault() const noexcept {
    if (is_stopped_) return Fault::kEmergencyStop;
    if (is_off_) return Fault::kForcesOff;
    return is_paused_ ? Fault::kPaused : Fault::kNone;
  }

  /// With RecoveryPolicy::kNever: the session does not end.
  bool waits_for_operator() const noexcept {
    return is_by_operator(state_.safety.fault) && !is_stopped_;
  }

  /// Whether time stands still in this period, in place of a tick: it is paused and torques are
  /// zero. A drive with a clock of its own is told so, since its watchdog waits for torques.
  bool stands_still(std::int64_t now_ns) noexcept {
    const bool is_idle = result_.at_rest || state_.safety.state == SafetyState::kRecovering;
    const bool stands = is_paused_ && !is_stopped_ && (is_idle || !options_.replay.empty());
    if (stands != stands_) {
      LiveEvent event;
      event.kind = stands ? LiveEventKind::kPaused : LiveEventKind::kResumed;
      event.t_s = result_.row.t_s;
      live_->event(event);
    }
    stands_ = stands;
    if (!stands) return false;
    if (options_.replay.empty() && !device_.is_paced_by_loop()) {
      DeviceState ignored = state_.device;
      device_.read(ignored);
      device_.write(DeviceCommand{});
    }
    live_tick_.is_paused = true;
    live_tick_.taken_ns = now_ns;
    live_->tick(live_tick_);
    return true;
  }

  void show(const TickTiming& timing, std::int64_t start_ns) noexcept {
    live_->count_tick(now_ns() - start_ns);
    if (is_real()) live_->count_wake(timing.late_ns);
    LiveTick& tick = live_tick_;
    tick.row = result_.row;
    tick.taken_ns = start_ns;
    const auto& load_A2s = state_.limits.load.excess_A2s;
    std::copy(load_A2s.data(), load_A2s.data() + kMotors, tick.motor_load_A2s.begin());
    tick.active_sheet = result_.contact.active_sheet;
    tick.force_N = result_.contact.force_N;
    tick.ticks = state_.tick;
    tick.missed_deadlines = timing.missed_deadlines;
    tick.late_max_ns = std::max(tick.late_max_ns, timing.late_ns);
    tick.punctures = report_.punctures.size() + report_.punctures_not_listed;
    tick.faults = report_.faults_count;
    if (result_.contact.phase == ContactPhase::kContact && tick.active_sheet >= 0)
      tick.sheets_touched |= std::uint64_t{1} << static_cast<unsigned>(tick.active_sheet);
    for (std::size_t i = 0; i < sheets_.size(); ++i)
      tick.sheet_cuts[i] = sheets_[i]->cuts;
    tick.is_paused = false;
    live_->tick(tick);
  }

  /// After the last tick, when the other threads have ended.
  void show_end() {
    live_->show_sheets(remesher_);
    live_->stop();  // so that the end is the last event
    LiveEvent event;
    event.kind = LiveEventKind::kEnded;
    event.t_s = result_.row.t_s;
    event.end = report_.end == SessionEnd::kDone    ? LiveEnd::kDone
                : report_.end == SessionEnd::kFault ? LiveEnd::kFault
                                                    : LiveEnd::kInterrupted;
    event.found.fault = report_.fault;
    live_->event(event);
    live_tick_.is_paused = false;
    live_tick_.has_ended = true;
    for (std::size_t i = 0; i < sheets_.size(); ++i)
      live_tick_.sheet_cuts[i] = remesher_.last_version(i).cuts;
    live_->tick(live_tick_);
    live_->stop();
  }

  /// Directly after the last tick: motors would hold the last torques while the other threads end.
  void write_zero_torques() noexcept { device_.write(DeviceCommand{}); }

  bool wants_recovery() noexcept {
    if (held_fault() != Fault::kNone) return false;
    if (std::exchange(recovery_asked_, false)) {
      if (options_.recover != nullptr) options_.recover->store(false);
      return true;
    }
    if (options_.recovery == RecoveryPolicy::kAuto) return true;
    return options_.recovery == RecoveryPolicy::kOnRequest && options_.recover != nullptr &&
           options_.recover->exchange(false);
  }

  /// Updates the list of faults and requests a black box for each. It is requested when torques are
  /// zero, so that it contains the whole ramp.
  void track_faults() noexcept {
    const RecordingRow& row = result_.row;
    if (black_box_ != nullptr) black_box_->push(row);
    if (options_.on_notice || live_ != nullptr) notify(row);
    FaultEvent* last = report_.faults.empty() || report_.faults_count > kMaxListedFaults
                           ? nullptr
                           : &report_.faults.back();
    if (result_.new_fault != Fault::kNone) {
      save_pending_ = !is_by_operator(result_.new_fault);
      last = nullptr;
      forget_request();  // an earlier one
      if (++report_.faults_count <= kMaxListedFaults) {
        FaultEvent event;
        event.fault = result_.new_fault;
        event.detail = result_.found;
        event.t_s = row.t_s;
        report_.faults.push_back(event);
        last = &report_.faults.back();
      }
    }
    if (result_.at_rest && last != nullptr && last->rest_t_s < 0) last->rest_t_s = row.t_s;
    if (result_.at_rest && save_pending_) {
      save_pending_ = false;
      if (black_box_ != nullptr) black_box_->save(state_.safety.fault, state_.safety.fault_t_s);
    }
    if (last != nullptr && last->recovered_t_s < 0 && row.safety == SafetyState::kRunning) {
      last->recovered_t_s = row.t_s;
    }
    report_.damping_max_N_s_per_m =
        std::max(report_.damping_max_N_s_per_m, row.passivity_N_s_per_m);
    if (row.passivity_N_s_per_m > 0) ++report_.damped_ticks;
  }

  void notify(const RecordingRow& row) noexcept {
    if (result_.new_fault != Fault::kNone) {
      stopped_by_ = result_.new_fault;
      watch_.fault_latched();
      tell(Notice::Kind::kFault, LiveEventKind::kFault, result_.found);
    }
    if (stopped_by_ == Fault::kNone) return;
    const bool waiting =
        row.safety == SafetyState::kRecovering || row.safety == SafetyState::kReady;
    if (watch_.tells(waiting, row.t_s, result_.found, result_.lift_m))
      tell(Notice::Kind::kNotRecovered, LiveEventKind::kNotRecovered, result_.found);
    if (row.safety != SafetyState::kRunning) return;
    tell(Notice::Kind::kRecovered, LiveEventKind::kRecovered, stopped_by_);
    stopped_by_ = Fault::kNone;
  }

  void tell(Notice::Kind kind, LiveEventKind live_kind, const FaultDetail& found) noexcept {
    const double t_s = result_.row.t_s;
    const double lift_m = kind == Notice::Kind::kNotRecovered ? result_.lift_m : 0;
    if (options_.on_notice) notices_.push({kind, t_s, found, lift_m});
    if (live_ == nullptr) return;
    LiveEvent event;
    event.kind = live_kind;
    event.t_s = t_s;
    event.found = found;
    event.lift_m = lift_m;
    live_->event(event);
  }

  void request_cut(const CutRequest& cut) noexcept {
    if (!remesher_.request(cut)) outside_ = Fault::kRemeshBacklog;
    (cut.is_puncture ? seen_.punctured : seen_.side_cut) |= std::uint64_t{1} << cut.sheet;
    if (!cut.is_puncture) {
      ++report_.cutting->side_cuts;
      return;
    }
    PunctureEvent event;
    event.sheet = cut.sheet;
    event.slice = sheets_[cut.sheet]->slice_index;
    event.cut = cut.cut;
    event.t_s = result_.row.t_s;
    event.tool_z_m = result_.contact.tip_device_m.z();
    event.penetration_m = result_.contact.penetration_m;
    const bool was_loaded = model_.body || last_active_sheet_ == cut.sheet;
    event.force_N = was_loaded ? model_.force_scale * last_force_N_ : 0;
    event.judged_force_N = result_.contact.judged_force_N;
    if (live_ != nullptr) show(event);
    if (report_.punctures.size() == kMaxListedPunctures) {
      ++report_.punctures_not_listed;
      return;
    }
    report_.punctures.push_back(event);
  }

  void show(const PunctureEvent& puncture) noexcept {
    live_tick_.sheets_punctured |= std::uint64_t{1} << static_cast<unsigned>(puncture.sheet);
    LiveEvent event;
    event.kind = LiveEventKind::kPuncture;
    event.t_s = puncture.t_s;
    event.sheet = puncture.sheet;
    event.slice = puncture.slice;
    event.cut = puncture.cut;
    event.tool_z_m = puncture.tool_z_m;
    event.penetration_m = puncture.penetration_m;
    event.force_N = puncture.force_N;
    event.judged_force_N = puncture.judged_force_N;
    live_->event(event);
  }

  /// The tick as on_tick gets it. Its sheets are set by request_cut().
  void see_tick() noexcept {
    seen_.row = result_.row;
    // A layer that was loaded and is punctured now; one that was not loaded has its hole already.
    std::uint64_t punctured = 0, loaded = 0;
    for (std::size_t i = 0; i < state_.body.law.layers.size(); ++i) {
      const SoftLayerState& layer = state_.body.law.layers[i];
      punctured |= std::uint64_t{layer.is_punctured} << i;
      loaded |= std::uint64_t{!layer.is_punctured && layer.stretch_m > 0} << i;
    }
    seen_.layers_punctured = punctured & loaded_layers_;
    loaded_layers_ = loaded;
    has_seen_ = true;
    if (tick_feed_ != nullptr) tick_feed_->push(seen_);
  }

  void update_report(const RecordingRow& row) noexcept {
    last_force_N_ = result_.contact.force_N;
    last_active_sheet_ = result_.contact.active_sheet;
    if (!options_.replay.empty() && report_.replay_first_difference < 0) {
      const RecordingRow& old = options_.replay[state_.tick - 1];
      if (!same_bits(old.tau_Nm, row.tau_Nm) || old.fault != row.fault ||
          old.cuts_published != row.cuts_published) {
        report_.replay_first_difference = static_cast<std::int64_t>(state_.tick - 1);
      }
    }
    for (const double tau : row.tau_Nm) {
      report_.torque_max_Nm = std::max(report_.torque_max_Nm, std::abs(tau));
    }
    const std::array<double, 6>& felt = row.wrench_delivered;
    report_.max_force_N = std::max(report_.max_force_N, std::hypot(felt[0], felt[1], felt[2]));
    if (report_.cutting) update_cutting(*report_.cutting);
    if (row.authority < 1) return;  // forces are off or ramped up
    if (row.wrench_scale < 1) ++report_.scaled_ticks;
    const double wanted = wrench_norm(row.wrench_wanted);
    if (wanted > 0) {
      std::array<double, 6> difference;
      for (int i = 0; i < 6; ++i)
        difference[i] = row.wrench_delivered[i] - row.wrench_wanted[i];
      report_.wrench_error_max =
          std::max(report_.wrench_error_max, wrench_norm(difference) / wanted);
    }
  }

  void update_cutting(CuttingReport& cutting) const noexcept {
    const CuttingResult& law = state_.body.result;
    cutting.tip_max_N = std::max(cutting.tip_max_N, law.tip_N);
    cutting.force_max_N = std::max(cutting.force_max_N, law.wrench_device.head<3>().norm());
    if (!law.has_converged) ++cutting.unconverged_ticks;
    cutting.steps_max = std::max(cutting.steps_max, law.steps);
  }

  bool is_real() const noexcept {
    return options_.clock == Clock::kReal && options_.replay.empty();
  }

  std::shared_ptr<const SheetShape> shape() const {
    return responder_ == nullptr ? nullptr : responder_->shape();
  }

  /// Real clock, on a separate thread.
  void show_frames(const std::atomic<bool>& done) {
    if (!options_.on_frame) return;
    RecordingRow row;
    while (!done.load()) {
      std::this_thread::sleep_for(std::chrono::duration<double>(1 / options_.frame_rate_Hz));
      if (for_frames_.read(row)) options_.on_frame(row, shape());
    }
  }

  /// Virtual clock, after a tick.
  void show_frame() {
    const double now_s = static_cast<double>(state_.tick - 1) / options_.rate_Hz;
    if (now_s * options_.frame_rate_Hz < static_cast<double>(frames_)) return;
    ++frames_;
    options_.on_frame(result_.row, shape());
  }

  /// Virtual clock, after a tick.
  void respond() {
    const auto period = static_cast<std::uint64_t>(
        std::max(1.0, std::round(options_.response_period_s * options_.rate_Hz)));
    const ResponseRequest& request = result_.contact.ahead;
    if (state_.tick % period != 0 || request.sheet < 0) return;
    const Sheet& sheet = remesher_.last_version(static_cast<std::size_t>(request.sheet));
    if (const auto found = responder_->answer(request, sheet)) {
      responses_due_.emplace_back(state_.tick - 1 + options_.handover_ticks, *found);
    }
  }

  /// Virtual clock, before a tick: puts the meshes and responses into use that are due, or that the
  /// recording has in this tick.
  void publish_due(std::deque<std::uint64_t>& due) {
    if (options_.replay.empty()) {
      while (!due.empty() && due.front() <= state_.tick) {
        due.pop_front();
        remesher_.publish_next();
      }
      while (!responses_due_.empty() && responses_due_.front().first <= state_.tick) {
        response_ = responses_due_.front().second;
        responses_due_.pop_front();
      }
      return;
    }
    if (state_.tick >= options_.replay.size()) return;
    const RecordingRow& row = options_.replay[state_.tick];
    response_ = {row.response_sheet, row.response_stiffness_N_per_m, row.response_offset_m};
    std::int64_t missing = row.cuts_published - cuts_published_;
    while (missing-- > 0 && remesher_.publish_next()) {
    }
  }

  Notices notices_;  // first, as it is aligned to a cache line
  LoopModel model_;
  LoopState state_;
  TickResult result_;
  Remesher& remesher_;
  Responder* responder_;
  Device& device_;
  const std::function<void(double)>& advance_;
  const SessionOptions& options_;
  Recorder* recorder_;
  BlackBox* black_box_;
  LiveView* live_;
  LiveTick live_tick_;
  bool is_paused_ = false, is_off_ = false, is_stopped_ = false;  ///< held by the operator
  bool recovery_asked_ = false;                                   ///< by a command
  bool stands_ = false;                                           ///< time stands still
  TickFeed* tick_feed_;
  SeenTick seen_;
  std::uint64_t loaded_layers_ = 0;
  bool has_seen_ = false;
  RecoveryWatch watch_;
  Fault stopped_by_ = Fault::kNone;  ///< until `running` begins again
  bool save_pending_ = false;
  Fault outside_ = Fault::kNone;  ///< for the next tick
  std::uint64_t ticks_;
  std::vector<const Sheet*> sheets_;
  std::int64_t cuts_published_ = 0;
  TripleBuffer<RecordingRow> for_frames_;
  std::uint64_t frames_ = 0;
  SheetResponse response_;
  std::deque<std::pair<std::uint64_t, SheetResponse>> responses_due_;  ///< virtual clock: at a tick
  double last_force_N_ = 0;
  std::int32_t last_active_sheet_ = -1;
  SessionReport report_;
};

}  // namespace

HandTrajectory hand_trajectory(const Scene& scene) {
  HandTrajectory trajectory;
  for (const TipKeyframe& keyframe : scene.hand.trajectory) {
    HandKeyframe frame;
    frame.t_s = keyframe.t_s;
    frame.T_device_tool.p_m = Eigen::Vector3d(keyframe.tip_m.data());
    frame.T_device_tool.q = from_rotation_vector(Eigen::Vector3d(keyframe.rotation_deg.data()) *
                                                 (std::numbers::pi / 180));
    trajectory.keyframes.push_back(frame);
  }
  return trajectory;
}

Result<SimulatedDevice> make_simulated_device(const Scene& scene,
                                              const DeviceDescription& description,
                                              const std::optional<MechanicsOptions>& mechanics) {
  const SceneHand& hand = scene.hand;
  HandImpedance impedance = hand.grip == HandGrip::kLight   ? light_grip()
                            : hand.grip == HandGrip::kStiff ? stiff_grip()
                                                            : HandImpedance{};
  impedance.stiffness_N_per_m = hand.stiffness_N_per_m.value_or(impedance.stiffness_N_per_m);
  impedance.damping_Ns_per_m = hand.damping_N_s_per_m.value_or(impedance.damping_Ns_per_m);
  impedance.rotational_stiffness_Nm_per_rad =
      hand.rotation_stiffness_Nm_per_rad.value_or(impedance.rotational_stiffness_Nm_per_rad);
  impedance.rotational_damping_Nms_per_rad =
      hand.rotation_damping_Nm_s_per_rad.value_or(impedance.rotational_damping_Nms_per_rad);
  impedance.mass_kg = hand.mass_kg.value_or(impedance.mass_kg);
  impedance.let_go_t_s = hand.let_go_t_s.value_or(impedance.let_go_t_s);
  SimulatedDeviceOptions options;
  options.mechanics = mechanics;
  options.T_plate_tool.p_m = Eigen::Vector3d(scene.tool.tip_in_plate_m.data());
  return SimulatedDevice::make(description, hand_trajectory(scene), impedance, options);
}

Result<SessionWorkers> make_workers(const Scene& scene, const DeviceDescription& description,
                                    const Remesher& remesher, const SessionOptions& options) {
  SessionWorkers workers;
  if (options.record) {
    Result<RecordingWriter> writer = RecordingWriter::open(*options.record, options.origin);
    if (!writer) return writer.error();
    workers.recorder = std::make_unique<Recorder>(std::move(*writer), options.on_recording_error);
  }
  if (options.black_box) {
    auto made = BlackBox::make(*options.black_box, options.rate_Hz, options.origin);
    if (!made) return made.error();
    workers.black_box = std::move(*made);
  }
  if (options.on_tick && options.clock == Clock::kReal && options.replay.empty())
    workers.tick_feed = std::make_unique<TickFeed>(options.on_tick);
  if (needs_response(scene.force_law.kind)) {
    std::vector<Tissue> tissues;
    for (std::size_t i = 0; i < remesher.size(); ++i)
      tissues.push_back(remesher.first_version(i).tissue);
    auto made = Responder::make(scene, tissues, remesher.first_version(0).transform.lattice);
    if (!made) return made.error();
    workers.responder = std::move(*made);
  }
  if (scene.force_law.kind == ForceLawKind::kCutting) {
    std::vector<const Sheet*> sheets;
    for (std::size_t i = 0; i < remesher.size(); ++i)
      sheets.push_back(&remesher.first_version(i));
    Result<SessionBody> body = make_session_body(scene, description, sheets, options.rate_Hz);
    if (!body) return body.error();
    workers.body = std::move(*body);
  }
  if (options.live_memory) {
    auto live = LiveView::make(scene, description, remesher, workers.responder.get(), options);
    if (!live) return live.error();
    workers.live = std::move(*live);
  }
  return workers;
}

SessionReport run_session(const Scene& scene, const DeviceDescription& description,
                          Remesher& remesher, Device& device,
                          const std::function<void(double dt_s)>& advance,
                          const SessionOptions& options, SessionWorkers workers) {
  auto session = std::make_unique<SessionLoop>(scene, description, remesher, device, advance,
                                               options, workers);
  const std::uint64_t allocations_before = allocations_in_scopes();
  if (options.clock == Clock::kReal && options.replay.empty()) {
    session->run_real();
  } else {
    session->run_virtual();
  }
  SessionReport report = session->finish();
  if (allocations_are_counted()) {
    report.allocations_in_loop = allocations_in_scopes() - allocations_before;
  }
  if (workers.responder) report.responder = workers.responder->report();
  if (workers.recorder) {
    if (Result<void> written = workers.recorder->finish(); !written) {
      report.recording_error = written.error();
    }
  }
  return report;
}

Result<SessionReport> run_session(const Scene& scene, const DeviceDescription& description,
                                  Remesher& remesher, Device& device,
                                  const std::function<void(double dt_s)>& advance,
                                  const SessionOptions& options) {
  Result<SessionWorkers> workers = make_workers(scene, description, remesher, options);
  if (!workers) return workers.error();
  return run_session(scene, description, remesher, device, advance, options, std::move(*workers));
}

std::uint64_t tick_count(double duration_s, double rate_Hz) {
  // Rounding must not add a tick to a duration of whole periods.
  const double ticks = duration_s * rate_Hz;
  const double nearest = std::round(ticks);
  return static_cast<std::uint64_t>(
      std::max(1.0, std::abs(ticks - nearest) < 1e-6 ? nearest : std::ceil(ticks)));
}

Result<double> recorded_rate_Hz(std::span<const RecordingRow> rows, const std::string& name,
                                double stated_Hz) {
  if (rows.size() < 2) return refused(name + ": one row alone has no rate");
  if (rows.front().t_s != 0) {
    return refused(name +
                   ": does not begin at the start of its session, as a black box of a longer "
                   "one; it cannot be replayed");
  }
  const double exact = static_cast<double>(rows.size() - 1) / rows.back().t_s;
  if (!(exact >= kMinRate_Hz * (1 - 1e-12) && exact <= kMaxRate_Hz * (1 + 1e-12))) {
    return refused(name + ": its rate is outside the range of the loop");
  }
  // Rates are set by users, as short decimals: the shortest decimal that gives every row's time is
  // taken. `exact` may be off by a few roundings.
  std::size_t most_rows = 0;  // whose times a candidate matched
  const auto fits = [&](double rate_Hz) {
    std::size_t k = 0;
    while (k < rows.size() && rows[k].t_s == static_cast<double>(k) / rate_Hz)
      ++k;
    most_rows = std::max(most_rows, k);
    return k == rows.size() && rate_Hz >= kMinRate_Hz && rate_Hz <= kMaxRate_Hz;
  };
  if (fits(stated_Hz)) return stated_Hz;
  std::array<char, 32> text;
  for (int digits = 1; digits <= std::numeric_limits<double>::max_digits10; ++digits) {
    std::snprintf(text.data(), text.size(), "%.*g", digits, exact);
    const double rate_Hz = std::strtod(text.data(), nullptr);
    if (fits(rate_Hz)) return rate_Hz;
  }
  double below = exact, above = exact;
  for (int i = 0; i < 4; ++i) {
    below = std::nextafter(below, 0);
    above = std::nextafter(above, std::numeric_limits<double>::infinity());
    if (fits(below)) return below;
    if (fits(above)) return above;
  }
  return refused(name + ": row " + std::to_string(most_rows + 1) +
                 " has an unexpected time: no rate gives the times of all rows to the last bit");
}

}  // namespace trocar::runtime
