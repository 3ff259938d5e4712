// SPDX-License-Identifier: Apache-2.0
#include "runtime/telemetry/session_publisher.h"

#include <algorithm>

#include "runtime/realtime/monotonic_clock.h"
#include "runtime/telemetry/recorder.h"

namespace trocar::runtime {

SessionPublisher::SessionPublisher() : TickObserver(std::chrono::milliseconds(4)) {}

Result<std::unique_ptr<SessionPublisher>> SessionPublisher::make(const Scene& scene,
                                                                 const DeviceSpecification& device,
                                                                 const Remesher& remesher,
                                                                 const PrefetchWorker* prefetch,
                                                                 const TelemetryOptions& options,
                                                                 const PublishedSession& session) {
  std::unique_ptr<SessionPublisher> made(new SessionPublisher);
  made->prefetch_ = prefetch;
  made->recorder_ = session.recorder;
  made->rate_Hz_ = session.rate_Hz;
  made->tool_ = make_tool(scene.tool);
  made->values_.resize(snapshot_size());
  TelemetrySizes sizes;
  sizes.about = session_facts(scene, device, remesher, options, session);
  sizes.columns = snapshot_size();
  sizes.has_shape = prefetch != nullptr;
  sizes.has_hand = options.hand.has_value();
  for (std::size_t i = 0; i < remesher.size(); ++i) {
    const Sheet& sheet = remesher.first_version(i);
    const FirstSheet& first = made->first_.emplace_back(sheet);
    sizes.sheets.push_back(
        {sheet.mesh.vertices_in_use(), sheet.mesh.triangles_in_use(), first.has_hu()});
    made->slices_.push_back(sheet.slice_index);
  }
  made->published_cuts_.assign(remesher.size(), -1);
  auto writer = TelemetryWriter::make(sizes);
  if (!writer) return writer.error();
  made->writer_ = std::move(*writer);
  made->publish_sheets(remesher);
  made->write(TelemetryTick{});
  if (Result<void> linked = made->writer_->link(options.file); !linked) return linked.error();
  return made;
}

TelemetryCommands SessionPublisher::take_commands() noexcept {
  const auto given = [this](TelemetryCommand command) {
    const std::uint64_t count = writer_->commands(command);
    return count != std::exchange(taken_[static_cast<std::size_t>(command)], count);
  };
  // Shots are counted: two of them between two ticks are two.
  constexpr auto kShots = static_cast<std::size_t>(TelemetryCommand::kXrayShot);
  const std::uint64_t shots = writer_->commands(TelemetryCommand::kXrayShot);
  return {.stop = given(TelemetryCommand::kStop),
          .pause = given(TelemetryCommand::kPause),
          .resume = given(TelemetryCommand::kResume),
          .zero = given(TelemetryCommand::kZero),
          .recover = given(TelemetryCommand::kRecover),
          .emergency_stop = given(TelemetryCommand::kEmergencyStop),
          .xray_shots = shots - std::exchange(taken_[kShots], shots),
          .screening = writer_->screening()};
}

void SessionPublisher::push(const TelemetryEvent& event) noexcept {
  if (!events_.push(event)) lost_events_.fetch_add(1, std::memory_order_relaxed);
}

void SessionPublisher::push_event(TelemetryEventKind kind, double t_s) noexcept {
  TelemetryEvent event;
  event.kind = kind;
  event.t_s = t_s;
  push(event);
}

void SessionPublisher::on_puncture(const PunctureEvent& puncture) noexcept {
  ++tick_.punctures;
  tick_.sheets_punctured |= std::uint64_t{1} << static_cast<unsigned>(puncture.sheet);
  TelemetryEvent event;
  event.kind = TelemetryEventKind::kPuncture;
  event.t_s = puncture.t_s;
  event.sheet = puncture.sheet;
  event.slice = puncture.slice;
  event.cut = puncture.cut;
  event.tool_z_m = puncture.tool_z_m;
  event.penetration_m = puncture.penetration_m;
  event.tip_N = puncture.tip_N;
  event.hand_N = puncture.hand_N;
  event.trial_force_N = puncture.trial_force_N;
  push(event);
}

void SessionPublisher::on_break_through(const BreakThroughEvent& found) noexcept {
  ++tick_.break_throughs;
  TelemetryEvent event;
  event.kind = TelemetryEventKind::kBreakThrough;
  event.t_s = found.t_s;
  event.sheet = found.sheet;
  event.slice = found.at;
  event.tool_z_m = found.tool_z_m;
  event.tip_N = found.resistance_N;
  push(event);
}

void SessionPublisher::on_message(const OperatorMessage& message) noexcept {
  using Kind = OperatorMessage::Kind;
  TelemetryEvent event;
  event.kind = message.kind == Kind::kFault       ? TelemetryEventKind::kFault
               : message.kind == Kind::kRecovered ? TelemetryEventKind::kRecovered
               : message.kind == Kind::kRefused   ? TelemetryEventKind::kRecoveryRefused
                                                  : TelemetryEventKind::kNotRecovered;
  event.t_s = message.t_s;
  event.found = message.detail;
  event.retract_distance_m = message.retract_distance_m;
  push(event);
}

void SessionPublisher::count_xray(const RecordingRow& row) noexcept {
  const bool was_screening = xray_.is_screening;
  xray_.add(row);
  if ((row.xray & kXrayPicture) != 0) push_event(TelemetryEventKind::kXrayShot, row.t_s);
  if (xray_.is_screening != was_screening)
    push_event(was_screening ? TelemetryEventKind::kXrayOff : TelemetryEventKind::kXrayOn, row.t_s);
  tick_.xray_shots = xray_.shots;
  tick_.xray_screening_s = xray_.screening_s(rate_Hz_);
}

void SessionPublisher::on_tick(const TickView& view) noexcept {
  count_xray(view.result.row);
  tick_times_.add(monotonic_ns() - view.start_ns);
  if (view.is_real_time) wake_times_.add(view.timing.late_ns);
  const ContactOutput& contact = view.result.contact;
  tick_.row = view.result.row;
  tick_.taken_ns = view.start_ns;
  tick_.readout = view.result.readout;
  tick_.active_sheet = contact.active_sheet;
  tick_.ticks = view.state.tick;
  tick_.missed_deadlines = view.timing.missed_deadlines;
  tick_.late_ticks = view.late_ticks;
  tick_.late_max_ns = std::max(tick_.late_max_ns, view.timing.late_ns);
  if (view.result.new_fault != Fault::kNone) ++tick_.faults;
  if (contact.phase == ContactPhase::kContact && contact.active_sheet >= 0)
    tick_.sheets_touched |= std::uint64_t{1} << static_cast<unsigned>(contact.active_sheet);
  for (std::size_t i = 0; i < view.sheets.size(); ++i)
    tick_.sheet_cuts[i] = view.sheets[i]->cuts;
  tick_.is_paused = false;
  ticks_.write(tick_);
}

void SessionPublisher::end_screening() noexcept {
  if (std::exchange(xray_.is_screening, false))
    push_event(TelemetryEventKind::kXrayOff, tick_.row.t_s);
}

void SessionPublisher::on_paused_period(std::int64_t now_ns) noexcept {
  end_screening();
  tick_.is_paused = true;
  tick_.taken_ns = now_ns;
  ticks_.write(tick_);
}

void SessionPublisher::publish_sheets(const Remesher& remesher) {
  for (std::size_t i = 0; i < published_cuts_.size(); ++i) {
    const Sheet& sheet = remesher.published_version(i);
    if (sheet.cuts == published_cuts_[i]) continue;
    writer_->sheet(i, first_[i].published(sheet));
    published_cuts_[i] = sheet.cuts;
    if (sheet.cuts == 0) continue;
    TelemetryEvent event;
    event.kind = TelemetryEventKind::kCutShown;
    event.t_s = last_t_s_.load(std::memory_order_relaxed);
    event.sheet = static_cast<std::int32_t>(i);
    event.slice = sheet.slice_index;
    event.cut = sheet.cuts;
    if (!sheet_events_.push(event)) lost_events_.fetch_add(1, std::memory_order_relaxed);
  }
}

void SessionPublisher::publish_shape() {
  if (prefetch_ == nullptr) return;
  std::shared_ptr<const SheetShape> latest = prefetch_->shape();
  if (latest == nullptr || latest == shape_) return;
  shape_ = std::move(latest);
  TelemetryShape shape = published(*shape_, slices_);
  shape.version = ++shapes_;
  writer_->shape(shape);
}

void SessionPublisher::write(const TelemetryTick& tick) {
  SnapshotSource source{tick, tool_, tick_times_, wake_times_, writer_->last_event()};
  if (recorder_ != nullptr) source.recording_left_s = recorder_->left_s();
  snapshot_values(source, values_);
  writer_->snapshot(values_);
}

void SessionPublisher::serve() {
  if (writer_ == nullptr) return;
  TelemetryEvent event;
  while (events_.pop(event))
    writer_->event(event);
  while (sheet_events_.pop(event))
    writer_->event(event);
  writer_->lose_events(lost_events_.exchange(0, std::memory_order_relaxed));
  publish_shape();
  TelemetryTick tick;
  if (!ticks_.read(tick)) return;
  last_t_s_.store(tick.row.t_s, std::memory_order_relaxed);
  write(tick);
}

void SessionPublisher::end(TelemetryEnd end, Fault fault, const Remesher& remesher) {
  publish_sheets(remesher);
  end_screening();
  stop();  // so that kEnded is the last event
  TelemetryEvent event;
  event.kind = TelemetryEventKind::kEnded;
  event.t_s = tick_.row.t_s;
  event.end = end;
  event.found.fault = fault;
  push(event);
  tick_.is_paused = false;
  tick_.has_ended = true;
  for (std::size_t i = 0; i < remesher.size(); ++i)
    tick_.sheet_cuts[i] = remesher.last_version(i).cuts;
  ticks_.write(tick_);
  serve();
}

}  // namespace trocar::runtime
