// SPDX-License-Identifier: Apache-2.0
#include "runtime/reporting/session_observer.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "formats/session/fault_words.h"

namespace trocar::runtime {
namespace {

double force_of(const RecordingRow& row) noexcept {
  const std::array<double, 6>& w = row.wrench_delivered;
  return length({w[0], w[1], w[2]});
}
bool counts(const RecordingRow& row) noexcept {
  return row.safety == SafetyState::kReady || row.safety == SafetyState::kRunning;
}

bool is_in_bone(const RecordingRow& row) {
  return (row.phase == ContactPhase::kContact || row.phase == ContactPhase::kPunctured) &&
         row.active_slice >= 0;
}

}  // namespace

SessionObserver::SessionObserver(const Scene& scene, std::vector<ReportSheet> sheets,
                                 double rate_Hz)
    : scene_(scene),
      sheets_(std::move(sheets)),
      plunge_(scene, sheets_, rate_Hz),
      tremor_(scene, rate_Hz) {
  out_.rate_Hz = rate_Hz;
  out_.top_z_m = -std::numeric_limits<double>::infinity();
  for (const ReportSheet& sheet : sheets_)
    out_.top_z_m = std::max(out_.top_z_m, sheet.z_m);
  for (const SceneLayer& layer : scene.layers)
    out_.top_z_m = std::max(out_.top_z_m, layer.top_z_m);
  out_.lowest_z_m = std::numeric_limits<double>::infinity();
  if (scene.goals) {
    out_.zones.resize(scene.goals->zones.size());
    goals_.emplace(*scene.goals);
  }
  out_.samples.reserve(kMaxReportSamples);
}

void SessionObserver::observe(const ObservedTick& tick) {
  const RecordingRow& row = tick.row;
  ++out_.ticks;
  const double force_N = force_of(row);
  if (force_N > out_.force_max_N || out_.ticks == 1) {
    out_.force_max_N = force_N;
    out_.force_max_t_s = row.t_s;
    out_.force_max_tip_m = row.tool_m;
  }
  if (row.safety != SafetyState::kIdle) sample(row, force_N);
  observe_fault(row);
  plunge_.observe(row, tick.break_through, out_);
  if (counts(row)) {
    observe_counted(tick, force_N);
  } else {
    observe_gap();
  }
  last_hand_N_ = force_N;
  last_t_s_ = row.t_s;
  last_front_HU_ = front_HU(row);
}

void SessionObserver::observe_counted(const ObservedTick& tick, double force_N) {
  const RecordingRow& row = tick.row;
  ++out_.counted;
  out_.counted_sum_N += force_N;
  if (row.phase == ContactPhase::kFree) ++out_.free;
  if (row.phase == ContactPhase::kContact) {
    ++out_.contact;
    out_.contact_sum_N += force_N;
  }
  if (row.phase == ContactPhase::kPunctured || row.phase == ContactPhase::kMissed) ++out_.through;
  observe_attempt(row);
  observe_path(tick);
  observe_punctures(tick);
  tremor_.observe(row, out_);
  if (goals_) goals_->observe(row, out_);
  observe_miss(row);
}

/// A row that is not counted ends every run of counted rows.
void SessionObserver::observe_gap() {
  last_tip_.reset();
  tremor_.restart();
  if (goals_) goals_->interrupt();
  is_missed_ = is_counted_ = is_in_layers_ = false;
}

void SessionObserver::observe_path(const ObservedTick& tick) {
  const RecordingRow& row = tick.row;
  const bool is_touching =
      row.phase == ContactPhase::kContact || (tick.punctured | tick.layers_punctured) != 0;
  const Vector3& tip = row.tool_m;
  const double step_m = last_tip_ ? length(minus(tip, *last_tip_)) : 0;
  last_tip_ = tip;
  out_.length_m += step_m;
  if (tip[2] < out_.lowest_z_m) {
    out_.lowest_z_m = tip[2];
    out_.lowest_m = tip;
    out_.lowest_q = row.q;
    out_.lowest_t_s = row.t_s;
  }
  if (out_.first_contact_s) {
    length_since_contact_m_ += step_m;
  } else if (is_touching) {
    out_.first_contact_s = row.t_s;
    contact_tip_ = tip;
    lowest_inserted_m_ = tip[2];
  }
  if (out_.first_contact_s && tip[2] < lowest_inserted_m_) {
    lowest_inserted_m_ = tip[2];
    out_.insertion_m = length_since_contact_m_;
    out_.straight_m = length(minus(tip, contact_tip_));
  }
}

void SessionObserver::observe_attempt(const RecordingRow& row) {
  if (is_in_bone(row)) {
    const bool was_below = is_missed_ || (is_in_layers_ && row.phase == ContactPhase::kPunctured);
    const bool comes_back =
        out_.attempts.count > 0 && was_below && last_tip_ && row.tool_m[2] > (*last_tip_)[2];
    if (!in_bone_tip_ && !comes_back) out_.attempts.add({-1, row.t_s, row.t_s, 0, 0});
    if (Span* const last = out_.attempts.last()) last->to_s = row.t_s;
    in_bone_tip_ = row.tool_m;
  } else if (in_bone_tip_ && length(minus(row.tool_m, *in_bone_tip_)) >= kLeave_m) {
    in_bone_tip_.reset();
  }
  is_in_layers_ = row.phase == ContactPhase::kContact && !is_in_bone(row);
}

void SessionObserver::observe_punctures(const ObservedTick& tick) {
  const RecordingRow& row = tick.row;
  const auto height = [&](const Punctured& what) { return height_of(what, scene_, sheets_); };
  const auto add = [&](const Punctured& what) {
    const double tip_z_m = row.tool_m[2];
    out_.punctures.add(
        {what, row.t_s, last_hand_N_, tick.tip_N, height(what) - tip_z_m, tip_z_m, last_front_HU_});
    out_.last_puncture_s = row.t_s;
  };
  for (std::size_t i = 0; i < scene_.layers.size(); ++i) {
    if ((tick.layers_punctured >> i & 1U) != 0) add({true, i});
  }
  for (std::size_t i = 0; i < sheets_.size(); ++i) {
    if ((tick.punctured >> i & 1U) != 0) add({false, i});
    if ((tick.side_cut >> i & 1U) != 0)
      out_.side_cuts.add({sheets_[i].slice, row.t_s, row.t_s, 0, 0});
  }
}

void SessionObserver::observe_miss(const RecordingRow& row) {
  const double z_m = row.tool_m[2];
  if (row.phase == ContactPhase::kFree) {
    count_doubtful();
    surface_z_m_.reset();
  } else if (is_in_bone(row)) {
    doubtful_ = {};  // it was air above the bone
    surface_z_m_ = std::max(surface_z_m_.value_or(z_m), z_m);
  }
  is_missed_ = row.phase == ContactPhase::kMissed;
  if (!is_missed_ || (surface_z_m_ && z_m > *surface_z_m_ + kLeave_m)) {
    is_counted_ = false;
    return;
  }
  Misses& misses = surface_z_m_ ? sure_ : doubtful_;
  ++misses.ticks;
  if (!is_counted_ || missed_slice_ != row.active_slice)
    misses.spans.add({row.active_slice, row.t_s, row.t_s, 0, 0});
  if (Span* const last = misses.spans.last()) last->to_s = row.t_s;
  is_counted_ = true;
  missed_slice_ = row.active_slice;
}

void SessionObserver::count_doubtful() {
  sure_.ticks += doubtful_.ticks;
  const std::uint64_t count = sure_.spans.count + doubtful_.spans.count;
  for (const Span& span : doubtful_.spans.list)
    sure_.spans.add(span);
  sure_.spans.count = count;
  doubtful_ = {};
}

void SessionObserver::observe_fault(const RecordingRow& row) {
  const bool is_new = fault_starts_.take(row);
  if (is_new && is_by_operator(row.fault)) {
    ++out_.operator_stops_count;
  } else if (is_new) {
    out_.faults.add({row.fault, row.t_s, {}});
  } else if (ReportFault* const last = out_.faults.last();
             last != nullptr && row.safety == SafetyState::kRunning && !last->recovered_s) {
    last->recovered_s = row.t_s;
  }
}

std::optional<double> SessionObserver::front_HU(const RecordingRow& row) const {
  return traits_of(scene_.force_law.kind).uses_bone_volume ? std::optional(row.cutting.front_HU)
                                                           : std::nullopt;
}

void SessionObserver::sample(const RecordingRow& row, double force_N) {
  std::vector<ReportSample>& list = out_.samples;
  const auto larger = [](const ReportSample& a, const ReportSample& b) {
    return b.hand_N > a.hand_N ? b : a;
  };
  const ReportSample made{row.t_s, row.tool_m, force_N, front_HU(row)};
  if (rows_sampled_ % out_.stride != 0) {
    list.back() = larger(list.back(), made);
  } else {
    if (list.size() == kMaxReportSamples) {
      for (std::size_t i = 0; i < kMaxReportSamples / 2; ++i)
        list[i] = larger(list[2 * i], list[2 * i + 1]);
      list.resize(kMaxReportSamples / 2);
      out_.stride *= 2;
    }
    list.push_back(made);
  }
  ++rows_sampled_;
}

SessionFigures SessionObserver::figures() {
  plunge_.end(PlungeEnd::kEnd, last_t_s_, out_);
  if (goals_) goals_->judge(out_);
  count_doubtful();
  out_.misses = std::move(sure_.spans);
  out_.missed_ticks = sure_.ticks;
  return std::move(out_);
}

}  // namespace trocar::runtime
