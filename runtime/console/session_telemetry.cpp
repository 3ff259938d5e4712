// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/session_telemetry.h"

#include <cmath>

#include "runtime/console/api.h"

namespace trocar::runtime {

void ForceHistory::add(const Point& point) {
  if (!(point.t_s > last_t_s_)) return;
  last_t_s_ = point.t_s;
  if (!largest_ || point.force_N > largest_->force_N) largest_ = point;
  if (++pending_ < every_) return;
  points_.push_back(*largest_);
  pending_ = 0;
  largest_.reset();
  if (points_.size() <= kMaxPoints) return;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < points_.size(); i += 2) {
    const bool is_next_larger =
        i + 1 < points_.size() && !(points_[i].force_N > points_[i + 1].force_N);
    points_[kept++] = points_[is_next_larger ? i + 1 : i];
  }
  points_.resize(kept);
  every_ *= 2;
}

namespace {

// An event takes about 300 bytes here, so a session of any length takes at most about 6 MB.
constexpr std::size_t kMaxEvents = 20'000;
constexpr int kMaxEventsOfPoll = 512, kMaxSheetsOfPoll = 2;

}  // namespace

void SessionTelemetry::attach(std::unique_ptr<TelemetryReader> reader) {
  clear();
  reader_ = std::move(reader);
  about_ = parse_about(reader_->about(), reader_->columns());
  about_.slices.resize(reader_->sheets(), -1);
  sheets_.assign(reader_->sheets(), {});
}

void SessionTelemetry::clear() {
  reader_.reset();
  about_ = {};
  sheets_.clear();
  shape_ = {};
  values_.clear();
  snapshot_.reset();
  history_.clear();
  events_.clear();
  last_event_ = 0;
  has_ended_ = false;
  ++sessions_;
}

void SessionTelemetry::move_hand(const std::optional<std::array<double, 6>>& target) {
  // The count goes on from one session to the next, so it differs from what an earlier console left only by
  // chance; then the session takes the second message.
  TelemetryHand hand;
  hand.count = ++hand_messages_;
  hand.is_held = target.has_value();
  hand.target = target.value_or(hand.target);
  reader_->hand(hand);
}

void SessionTelemetry::poll() {
  if (!reader_) return;
  if (reader_->snapshot(values_)) {
    ++snapshots_;
    snapshot_ = std::make_shared<const std::string>(snapshot_message(values_));
    // Before the device has been read, its pose means nothing.
    if (value("safety") != 0)
      history_.add({value("t_s"),
                    std::hypot(value("wrench_delivered", 0), value("wrench_delivered", 1),
                               value("wrench_delivered", 2)),
                    value("tool_m", 2)});
  }
  read_events();
  read_meshes();
}

double SessionTelemetry::value(const char* column, std::size_t at) const {
  for (const auto& [name, first] : about_.column_at) {
    if (name == column && first + at < values_.size()) return values_[first + at];
  }
  return 0;
}

void SessionTelemetry::read_events() {
  TelemetryEvent event;
  std::uint64_t lost = 0;
  for (int i = 0; i < kMaxEventsOfPoll; ++i) {
    const TelemetryReader::Next next = reader_->next_event(event, lost);
    if (next == TelemetryReader::Next::kNone) return;
    // Clients detect a loss by the gap before the next number.
    if (next == TelemetryReader::Next::kLost) continue;
    last_event_ = event.number;
    events_.push_back({event.number, event_message(event)});
    if (events_.size() > kMaxEvents) events_.pop_front();
    has_ended_ = has_ended_ || event.kind == TelemetryEventKind::kEnded;
  }
}

void SessionTelemetry::read_meshes() {
  int read = 0;
  for (std::size_t i = 0; i < sheets_.size() && read < kMaxSheetsOfPoll; ++i) {
    const std::uint64_t version = reader_->sheet_version(i);
    TelemetrySheet sheet;
    if (version == sheets_[i].version || !reader_->sheet(i, sheet)) continue;
    ++read;
    sheets_[i].version = version;
    sheets_[i].frame = sheet.cuts == 0
                           ? nullptr
                           : std::make_shared<const std::string>(mesh_message(
                                 static_cast<std::int32_t>(i), sheet.cuts, about_.slices[i],
                                 sheet.xy_m, 2, sheet.hu, sheet.triangles));
  }
  TelemetryShape shape;
  const std::uint64_t version = reader_->shape_version();
  if (version != shape_.version && reader_->shape(shape)) {
    shape_.version = version;
    const std::int32_t slice =
        shape.sheet >= 0 && static_cast<std::size_t>(shape.sheet) < about_.slices.size()
            ? about_.slices[static_cast<std::size_t>(shape.sheet)]
            : -1;
    shape_.frame = std::make_shared<const std::string>(
        mesh_message(shape.sheet, shape.cuts, slice, shape.xyw, 3, {}, shape.triangles));
  }
}

}  // namespace trocar::runtime
