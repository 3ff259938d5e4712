// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/session_report.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <utility>

#include "formats/base/json_text.h"
#include "formats/session/fault_words.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;
using Place = std::array<double, 3>;

Place minus(const Place& a, const Place& b) noexcept {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
double dot(const Place& a, const Place& b) noexcept {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
double length(const Place& a) noexcept {
  return std::sqrt(dot(a, a));
}
double force_of(const RecordingRow& row) noexcept {
  const std::array<double, 6>& w = row.wrench_delivered;
  return length({w[0], w[1], w[2]});
}
bool counts(const RecordingRow& row) noexcept {
  return row.safety == SafetyState::kReady || row.safety == SafetyState::kRunning;
}

/// Distance from a polygon's border in its plane, negative inside.
double polygon_distance_m(const std::vector<std::array<double, 2>>& ring, double x, double y) {
  double least = std::numeric_limits<double>::infinity();
  bool inside = false;
  for (std::size_t i = 0, j = ring.size() - 1; i < ring.size(); j = i++) {
    const double ax = ring[j][0], ay = ring[j][1], bx = ring[i][0], by = ring[i][1];
    const double ux = bx - ax, uy = by - ay;
    const double along =
        std::clamp(((x - ax) * ux + (y - ay) * uy) / (ux * ux + uy * uy), 0.0, 1.0);
    least = std::min(least, std::hypot(x - ax - along * ux, y - ay - along * uy));
    if ((ay > y) != (by > y) && x < ax + (y - ay) / uy * ux) inside = !inside;
  }
  return inside ? -least : least;
}

std::uint64_t in_ticks(double t_s, double rate_Hz) {
  return static_cast<std::uint64_t>(std::max(1.0, std::round(t_s * rate_Hz)));
}

template <typename T>
void keep(std::vector<T>& list, std::size_t most, std::uint64_t& count, T value) {
  ++count;
  if (list.size() < most) list.push_back(std::move(value));
}

}  // namespace

double zone_distance_m(const ForbiddenZone& zone, const Place& p_m) {
  if (zone.shape == ForbiddenZone::Shape::kCapsule) {
    const Place way = minus(zone.high_m, zone.low_m), from = minus(p_m, zone.low_m);
    const double square = dot(way, way);
    const double along = square > 0 ? std::clamp(dot(from, way) / square, 0.0, 1.0) : 0;
    return length({from[0] - along * way[0], from[1] - along * way[1], from[2] - along * way[2]}) -
           zone.radius_m;
  }
  // Beyond each pair of sides; of a prism beyond its outline and its two ends.
  Place beyond{};
  if (zone.shape == ForbiddenZone::Shape::kBox) {
    for (std::size_t k = 0; k < 3; ++k)
      beyond[k] = std::max(zone.low_m[k] - p_m[k], p_m[k] - zone.high_m[k]);
  } else {
    beyond = {polygon_distance_m(zone.outline_m, p_m[0], p_m[1]),
              std::max(zone.z_m[0] - p_m[2], p_m[2] - zone.z_m[1]),
              -std::numeric_limits<double>::infinity()};
  }
  const double most = std::max({beyond[0], beyond[1], beyond[2]});
  if (most <= 0) return most;
  for (double& each : beyond)
    each = std::max(each, 0.0);
  return length(beyond);
}

Place TremorFilter::pass(const Place& in) noexcept {
  Place made{};
  for (std::size_t k = 0; k < 3; ++k)
    made[k] =
        (b[0] * in[k] + b[1] * x[0][k] + b[2] * x[1][k] - a[1] * y[0][k] - a[2] * y[1][k]) / a[0];
  x = {in, x[0]};
  y = {made, y[0]};
  return made;
}

SessionObserver::SessionObserver(const Scene& scene, std::vector<ReportSheet> sheets,
                                 double rate_Hz)
    : scene_(scene), sheets_(std::move(sheets)) {
  out_.rate_Hz = rate_Hz;
  out_.top_z_m = -std::numeric_limits<double>::infinity();
  for (const ReportSheet& sheet : sheets_)
    out_.top_z_m = std::max(out_.top_z_m, sheet.z_m);
  for (const SceneLayer& layer : scene.layers)
    out_.top_z_m = std::max(out_.top_z_m, layer.top_z_m);
  out_.lowest_z_m = std::numeric_limits<double>::infinity();
  if (scene.goals) out_.zones.resize(scene.goals->zones.size());
  in_zone_.resize(out_.zones.size());
  plunge_stop_ = in_ticks(kPlungeStop_s, rate_Hz);
  plunge_end_ = in_ticks(kPlunge_s, rate_Hz);
  settle_ = in_ticks(kTremorSettle_s, rate_Hz);
  recent_m_.resize(plunge_stop_);
  for (std::size_t i = 0; i < filter_.size(); ++i) {
    const bool is_high_pass = i == 0;
    const double w =
        2 * std::numbers::pi * (is_high_pass ? kTremorLow_Hz : kTremorHigh_Hz) / rate_Hz;
    const double cosine = std::cos(w), alpha = std::sin(w) / std::numbers::sqrt2;
    filter_[i].a = {1 + alpha, -2 * cosine, 1 - alpha};
    const double b = is_high_pass ? (1 + cosine) / 2 : (1 - cosine) / 2;
    filter_[i].b = {b, is_high_pass ? -(1 + cosine) : 1 - cosine, b};
  }
  out_.samples.reserve(kReportSamples);
}

double SessionObserver::height_of(const Punctured& what) const {
  return what.is_layer ? scene_.layers[what.index].top_z_m : sheets_[what.index].z_m;
}

void SessionObserver::see(const SeenTick& tick) {
  const RecordingRow& row = tick.row;
  ++out_.ticks;
  const double force_N = force_of(row);
  if (force_N > out_.force_max_N) {
    out_.force_max_N = force_N;
    out_.force_max_t_s = row.t_s;
    out_.force_max_tip_m = row.tool_m;
  }
  if (row.safety != SafetyState::kIdle) sample(row, force_N);
  see_fault(row);
  if (counts(row)) {
    ++out_.counted;
    if (row.phase == ContactPhase::kFree) ++out_.free;
    if (row.phase == ContactPhase::kContact) {
      ++out_.contact;
      out_.contact_sum_N += force_N;
    }
    if (row.phase == ContactPhase::kPunctured || row.phase == ContactPhase::kBeside) ++out_.through;
    see_path(row);
    see_punctures(tick);
    see_plunge(row);
    see_tremor(row);
    if (scene_.goals) see_goals(row);
    see_beside(row);
  } else {
    see_gap(row);
  }
  last_force_N_ = force_N;
  last_t_s_ = row.t_s;
}

/// A row that does not count ends what goes on.
void SessionObserver::see_gap(const RecordingRow& row) {
  last_tip_.reset();
  last_wanted_N_ = 0;
  end_plunge(PlungeEnd::kFault, row.t_s);
  filtered_ = 0;
  std::fill(in_zone_.begin(), in_zone_.end(), false);
  is_beside_ = false;
}

void SessionObserver::see_path(const RecordingRow& row) {
  const Place& tip = row.tool_m;
  const double step_m = last_tip_ ? length(minus(tip, *last_tip_)) : 0;
  last_tip_ = tip;
  out_.length_m += step_m;
  if (tip[2] < out_.lowest_z_m) {
    out_.lowest_z_m = tip[2];
    out_.lowest_m = tip;
  }
  if (out_.first_contact_s) {
    way_m_ += step_m;
  } else if (row.phase == ContactPhase::kContact) {
    out_.first_contact_s = row.t_s;
    contact_tip_ = tip;
    lowest_inserted_m_ = tip[2];
  }
  if (out_.first_contact_s && tip[2] < lowest_inserted_m_) {
    lowest_inserted_m_ = tip[2];
    out_.insertion_m = way_m_;
    out_.straight_m = length(minus(tip, contact_tip_));
  }
}

void SessionObserver::add_puncture(const Punctured& what, const RecordingRow& row) {
  ReportPuncture made;
  made.what = what;
  made.t_s = row.t_s;
  made.force_N = last_force_N_;
  made.depth_m = height_of(what) - row.tool_m[2];
  made.tip_z_m = row.tool_m[2];
  out_.last_puncture_s = row.t_s;
  keep(out_.punctures, kReportPunctures, out_.punctures_count, made);
}

void SessionObserver::see_punctures(const SeenTick& tick) {
  const RecordingRow& row = tick.row;
  std::optional<Punctured> lowest;
  const auto add = [&](const Punctured& what) {
    add_puncture(what, row);
    if (!lowest || height_of(what) < height_of(*lowest)) lowest = what;
  };
  for (std::size_t i = 0; i < scene_.layers.size(); ++i) {
    if ((tick.layers_punctured >> i & 1U) != 0) add({true, i});
  }
  for (std::size_t i = 0; i < sheets_.size(); ++i) {
    if ((tick.punctured >> i & 1U) != 0) add({false, i});
    if ((tick.side_cut >> i & 1U) != 0)
      keep(out_.side_cuts, kReportSpans, out_.side_cuts_count,
           Span{sheets_[i].slice, row.t_s, row.t_s, 0, 0});
  }
  constexpr double kFallen = 0.5;
  const double wanted_N =
      length({row.wrench_wanted[0], row.wrench_wanted[1], row.wrench_wanted[2]});
  const bool breaks_through = wanted_N <= kFallen * last_wanted_N_;
  last_wanted_N_ = wanted_N;
  if (!lowest || !breaks_through) return;
  end_plunge(PlungeEnd::kNext, row.t_s);
  open_.emplace();
  open_->what = *lowest;
  open_->t_s = open_->lowest_t_s = row.t_s;
  plunge_from_m_ = plunge_lowest_m_ = row.tool_m[2];
  plunge_ticks_ = 0;
}

/// From the tick of the break-through on.
void SessionObserver::see_plunge(const RecordingRow& row) {
  if (!open_) return;
  const double z_m = row.tool_m[2];
  double& earlier_m = recent_m_[plunge_ticks_ % recent_m_.size()];
  const bool stops = plunge_ticks_ >= plunge_stop_ && earlier_m - z_m < kPlungeStep_m;
  earlier_m = z_m;
  if (z_m < plunge_lowest_m_) {
    plunge_lowest_m_ = z_m;
    open_->lowest_t_s = row.t_s;
  }
  if (z_m - plunge_lowest_m_ > kPlungeStep_m) {
    end_plunge(PlungeEnd::kReversed, row.t_s);
  } else if (stops) {
    end_plunge(PlungeEnd::kStopped, row.t_s);
  } else if (plunge_ticks_ >= plunge_end_) {
    end_plunge(PlungeEnd::kTime, row.t_s);
  }
  ++plunge_ticks_;
}

void SessionObserver::end_plunge(PlungeEnd end, double t_s) {
  if (!open_) return;
  BreakThrough made = *std::exchange(open_, std::nullopt);
  made.plunge_m = plunge_from_m_ - plunge_lowest_m_;
  made.below_m = height_of(made.what) - plunge_lowest_m_;
  if (made.what.is_layer) made.below_m -= scene_.layers[made.what.index].thickness_m;
  made.ended_by = end;
  made.ended_t_s = t_s;
  out_.plunge_max_m = std::max(out_.plunge_max_m, made.plunge_m);
  keep(out_.break_throughs, kReportPunctures, out_.break_throughs_count, made);
}

void SessionObserver::see_tremor(const RecordingRow& row) {
  if (filtered_ == 0) {
    filter_zero_ = row.tool_m;
    for (TremorFilter& each : filter_)
      each.x = each.y = {};
  }
  const Place made = filter_[1].pass(filter_[0].pass(minus(row.tool_m, filter_zero_)));
  if (filtered_++ < settle_) return;
  Tremor* part = row.phase == ContactPhase::kFree      ? &out_.tremor_free
                 : row.phase == ContactPhase::kContact ? &out_.tremor_contact
                                                       : nullptr;
  if (part == nullptr) return;
  ++part->ticks;
  part->sideways_m2 += made[0] * made[0] + made[1] * made[1];
  part->squares_m2 += dot(made, made);
}

void SessionObserver::see_goals(const RecordingRow& row) {
  const SceneGoals& goals = *scene_.goals;
  const Place& tip = row.tool_m;
  if (goals.target) {
    const double away_m = length(minus(tip, goals.target->at_m));
    if (!out_.target_m || away_m < *out_.target_m) {
      out_.target_m = away_m;
      out_.target_t_s = row.t_s;
    }
    if (!out_.target_reached_s && away_m <= goals.target->radius_m) out_.target_reached_s = row.t_s;
  }
  if (goals.line) {
    const Place from = minus(tip, goals.line->entry_m);
    const Place& d = goals.line->direction;
    const double along = dot(from, d);
    if (along >= 0) {
      const double away_m =
          length({from[0] - along * d[0], from[1] - along * d[1], from[2] - along * d[2]});
      if (out_.line_ticks++ == 0) out_.line_entry_m = away_m;
      out_.line_max_m = std::max(out_.line_max_m, away_m);
      out_.line_squares_m2 += away_m * away_m;
    }
  }
  for (std::size_t i = 0; i < goals.zones.size(); ++i) {
    ZoneFigures& zone = out_.zones[i];
    const double away_m = zone_distance_m(goals.zones[i], tip);
    if (!zone.min_m || away_m < *zone.min_m) {
      zone.min_m = away_m;
      zone.min_t_s = row.t_s;
    }
    if (away_m < 0) {
      if (!in_zone_[i])
        keep(zone.breaches, kReportSpans, zone.breaches_count,
             Span{-1, row.t_s, row.t_s, 0, row.t_s});
      if (zone.breaches_count <= kReportSpans) {
        Span& breach = zone.breaches.back();
        breach.to_s = row.t_s;
        if (-away_m > breach.depth_m) {
          breach.depth_m = -away_m;
          breach.depth_t_s = row.t_s;
        }
      }
    }
    in_zone_[i] = away_m < 0;
  }
}

void SessionObserver::see_beside(const RecordingRow& row) {
  const bool beside = row.phase == ContactPhase::kBeside;
  if (beside) {
    ++out_.beside_ticks;
    if (!is_beside_ || beside_slice_ != row.active_slice)
      keep(out_.beside, kReportSpans, out_.beside_count,
           Span{row.active_slice, row.t_s, row.t_s, 0, 0});
    if (out_.beside_count <= kReportSpans) out_.beside.back().to_s = row.t_s;
  }
  is_beside_ = beside;
  beside_slice_ = row.active_slice;
}

void SessionObserver::see_fault(const RecordingRow& row) {
  const bool is_new = row.fault != Fault::kNone && row.fault != last_fault_;
  last_fault_ = row.fault;
  if (is_new) {
    keep(out_.faults, kReportSpans, out_.faults_count, {row.fault, row.t_s, {}});
  } else if (row.safety == SafetyState::kRunning && out_.faults_count > 0 &&
             out_.faults_count <= kReportSpans && !out_.faults.back().recovered_s) {
    out_.faults.back().recovered_s = row.t_s;
  }
}

void SessionObserver::sample(const RecordingRow& row, double force_N) {
  std::vector<ReportSample>& list = out_.samples;
  const auto larger = [](const ReportSample& a, const ReportSample& b) {
    return b.force_N > a.force_N ? b : a;
  };
  const ReportSample made{row.t_s, row.tool_m, force_N};
  if (in_sample_ % out_.stride != 0) {
    list.back() = larger(list.back(), made);
  } else {
    if (list.size() == kReportSamples) {
      for (std::size_t i = 0; i < kReportSamples / 2; ++i)
        list[i] = larger(list[2 * i], list[2 * i + 1]);
      list.resize(kReportSamples / 2);
      out_.stride *= 2;
    }
    list.push_back(made);
  }
  ++in_sample_;
}

SessionFigures SessionObserver::figures() {
  end_plunge(PlungeEnd::kEnd, last_t_s_);
  judge_goals();
  return std::move(out_);
}

void SessionObserver::judge_goals() {
  if (!scene_.goals) return;
  const SceneGoals& goals = *scene_.goals;
  const auto add = [&](GoalResult made) {
    made.met =
        made.value && (made.at_least ? *made.value >= made.limit : *made.value <= made.limit);
    out_.goals.push_back(std::move(made));
  };
  if (goals.target)
    add({"target", "", goals.target->radius_m, false, out_.target_m, "m", false,
         "smallest distance of the tip to the target, at most its radius"});
  std::optional<double> entry_m, line_m;
  if (out_.line_ticks > 0) {
    entry_m = out_.line_entry_m;
    line_m = out_.line_max_m;
  }
  if (goals.line && goals.line->entry_radius_m)
    add({"entry", "", *goals.line->entry_radius_m, false, entry_m, "m", false,
         "distance of the tip to the planned line as it first passes the entry point, at most the "
         "entry radius"});
  if (goals.line && goals.line->corridor_m)
    add({"corridor", "", *goals.line->corridor_m, false, line_m, "m", false,
         "largest distance of the tip to the planned line beyond the entry point, at most the "
         "corridor"});
  if (goals.force_max_N)
    add({"force", "", *goals.force_max_N, false, out_.force_max_N, "N", false,
         "largest force on the hand, at most the ceiling"});
  if (goals.time_max_s) {
    const std::optional<double> end_s = goals.target ? out_.target_reached_s : out_.last_puncture_s;
    std::optional<double> took_s;
    if (out_.first_contact_s && end_s) took_s = *end_s - *out_.first_contact_s;
    add({"time", "", *goals.time_max_s, false, took_s, "s", false,
         goals.target ? "from the first contact until the tip is first within the target's radius"
                      : "from the first contact until the last puncture"});
  }
  if (goals.plunge_max_m)
    add({"plunge", "", *goals.plunge_max_m, false, out_.plunge_max_m, "m", false,
         "largest plunge after a break-through (0 without any), at most the limit"});
  for (std::size_t i = 0; i < goals.zones.size(); ++i)
    add({"zone", goals.zones[i].name, goals.zones[i].margin_m, true, out_.zones[i].min_m, "m",
         false, "smallest distance of the tip to the zone, at least its margin; negative: inside"});
}

std::vector<std::array<double, 2>> material_along(const Sheet& sheet, int axis, double at_m) {
  std::vector<std::array<double, 2>> parts;
  const auto u = static_cast<Eigen::Index>(axis), v = 1 - u;
  for (const Triangle& triangle : sheet.mesh.triangles) {
    if (triangle == kFreeSlot) continue;
    std::array<Eigen::Vector2d, 3> corner;
    for (std::size_t k = 0; k < 3; ++k) {
      const LatticePoint p = sheet.mesh.vertices[triangle[k]];
      corner[k] = sheet.transform.to_scene(
          Eigen::Vector2d(static_cast<double>(p.x), static_cast<double>(p.y)));
    }
    double low_m = std::numeric_limits<double>::infinity(), high_m = -low_m;
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector2d &a = corner[k], &b = corner[(k + 1) % 3];
      if ((a[v] > at_m) == (b[v] > at_m)) continue;
      const double crossing_m = a[u] + (at_m - a[v]) / (b[v] - a[v]) * (b[u] - a[u]);
      low_m = std::min(low_m, crossing_m);
      high_m = std::max(high_m, crossing_m);
    }
    if (low_m < high_m) parts.push_back({low_m, high_m});
  }
  std::sort(parts.begin(), parts.end());
  constexpr double kJoined_m = 1e-5;
  std::vector<std::array<double, 2>> joined;
  for (const std::array<double, 2>& part : parts) {
    if (!joined.empty() && part[0] <= joined.back()[1] + kJoined_m)
      joined.back()[1] = std::max(joined.back()[1], part[1]);
    else
      joined.push_back(part);
  }
  return joined;
}

std::string fault_message(const ReportFault& fault, const ReportFacts& facts) {
  for (const FaultEvent& event : facts.faults) {
    if (event.fault == fault.fault && event.t_s == fault.t_s)
      return trocar::describe(event.detail, event.t_s);
  }
  return trocar::describe(FaultDetail(fault.fault), fault.t_s);
}

namespace {

json or_null(const std::optional<double>& value) {
  return value ? json(*value) : json(nullptr);
}

json describe(const Scene& scene, const ReportFacts& facts, const Punctured& what) {
  return {{"layer", what.is_layer ? json(scene.layers[what.index].name) : json(nullptr)},
          {"slice", what.is_layer ? json(nullptr) : json(facts.sheets[what.index].slice)}};
}

const char* name_of(PlungeEnd end) {
  constexpr std::array<const char*, 6> kNames = {"reversed", "stopped", "time",
                                                 "next",     "fault",   "end"};
  return kNames[static_cast<std::size_t>(end)];
}

json describe(const Tremor& tremor) {
  json out = {{"ticks", tremor.ticks}, {"rms_m", nullptr}, {"sideways_rms_m", nullptr}};
  if (tremor.ticks == 0) return out;
  const auto n = static_cast<double>(tremor.ticks);
  out["rms_m"] = std::sqrt(tremor.squares_m2 / n);
  out["sideways_rms_m"] = std::sqrt(tremor.sideways_m2 / n);
  return out;
}

json describe_goals(const Scene& scene, const SessionFigures& f) {
  json out = {{"line", nullptr}, {"target", nullptr}, {"zones", json::array()}};
  if (!scene.goals) return out;
  if (scene.goals->line) {
    out["line"] = {
        {"ticks", f.line_ticks}, {"max_m", nullptr}, {"rms_m", nullptr}, {"entry_m", nullptr}};
    if (f.line_ticks > 0) {
      out["line"]["max_m"] = f.line_max_m;
      out["line"]["rms_m"] = std::sqrt(f.line_squares_m2 / static_cast<double>(f.line_ticks));
      out["line"]["entry_m"] = f.line_entry_m;
    }
  }
  if (scene.goals->target) {
    out["target"] = {{"closest_m", or_null(f.target_m)},
                     {"closest_t_s", f.target_m ? json(f.target_t_s) : json(nullptr)},
                     {"reached_t_s", or_null(f.target_reached_s)}};
  }
  for (std::size_t i = 0; i < f.zones.size(); ++i) {
    const ZoneFigures& zone = f.zones[i];
    json breaches = json::array();
    for (const Span& span : zone.breaches)
      breaches.push_back({{"from_s", span.from_s},
                          {"to_s", span.to_s},
                          {"depth_m", span.depth_m},
                          {"depth_t_s", span.depth_t_s}});
    out["zones"].push_back({{"name", scene.goals->zones[i].name},
                            {"min_m", or_null(zone.min_m)},
                            {"min_t_s", zone.min_m ? json(zone.min_t_s) : json(nullptr)},
                            {"breaches", std::move(breaches)},
                            {"breaches_count", zone.breaches_count}});
  }
  return out;
}

json describe_samples(const SessionFigures& f) {
  json rows = json::array();
  for (const ReportSample& s : f.samples)
    rows.push_back({s.t_s, s.tip_m[0], s.tip_m[1], s.tip_m[2], s.force_N});
  return {{"stride", f.stride},
          {"columns", {"t_s", "tool_x_m", "tool_y_m", "tool_z_m", "force_N"}},
          {"rows", std::move(rows)}};
}

}  // namespace

std::string session_report_json(const Scene& scene, const SessionFigures& f,
                                const ReportFacts& facts) {
  const auto seconds = [&](std::uint64_t ticks) { return static_cast<double>(ticks) / f.rate_Hz; };
  const bool has_path = f.counted > 0;
  json out = describe_goals(scene, f);
  out["schema"] = "trocar.session-report/1";
  out["program"] = "trocar-run " TROCAR_VERSION;
  out["use"] = "for training, not for planning";
  out["scene"] = scene.name;
  out["asset"] = facts.asset;
  out["force_law"] = facts.force_law;
  out["clock"] = facts.is_virtual ? "virtual" : "real";
  out["end"] = facts.end == SessionEnd::kDone          ? "done"
               : facts.end == SessionEnd::kInterrupted ? "interrupted"
                                                       : "fault";
  out["rate_Hz"] = f.rate_Hz;
  out["ticks"] = f.ticks;
  out["ticks_counted"] = f.counted;
  out["ticks_lost"] = facts.lost_ticks;
  out["sheets"] = json::array();
  for (const ReportSheet& sheet : facts.sheets)
    out["sheets"].push_back(
        {{"slice", sheet.slice},
         {"z_m", sheet.z_m},
         {"tissue", sheet.tissue.empty() ? json(nullptr) : json(sheet.tissue)}});
  out["path"] = {{"length_m", f.length_m},
                 {"insertion_m", or_null(f.insertion_m)},
                 {"straight_m", or_null(f.straight_m)},
                 {"straightness", nullptr},
                 {"lowest_z_m", has_path ? json(f.lowest_z_m) : json(nullptr)},
                 {"depth_max_m", has_path ? json(f.top_z_m - f.lowest_z_m) : json(nullptr)}};
  if (f.insertion_m && *f.insertion_m > 0)
    out["path"]["straightness"] = *f.straight_m / *f.insertion_m;
  out["time"] = {{"total_s", seconds(f.ticks)},
                 {"free_s", seconds(f.free)},
                 {"contact_s", seconds(f.contact)},
                 {"through_s", seconds(f.through)},
                 {"stopped_s", seconds(f.ticks - f.counted)},
                 {"first_contact_s", or_null(f.first_contact_s)},
                 {"last_puncture_s", or_null(f.last_puncture_s)},
                 {"contact_to_last_puncture_s", nullptr}};
  if (f.first_contact_s && f.last_puncture_s)
    out["time"]["contact_to_last_puncture_s"] = *f.last_puncture_s - *f.first_contact_s;
  out["force"] = {{"max_N", f.force_max_N},
                  {"max_t_s", f.force_max_t_s},
                  {"max_tip_m", f.force_max_tip_m},
                  {"contact_mean_N", nullptr}};
  if (f.contact > 0)
    out["force"]["contact_mean_N"] = f.contact_sum_N / static_cast<double>(f.contact);
  out["punctures"] = json::array();
  for (const ReportPuncture& p : f.punctures) {
    json made = describe(scene, facts, p.what);
    made.update(
        {{"t_s", p.t_s}, {"force_N", p.force_N}, {"depth_m", p.depth_m}, {"tip_z_m", p.tip_z_m}});
    out["punctures"].push_back(std::move(made));
  }
  out["punctures_count"] = f.punctures_count;
  out["break_throughs"] = json::array();
  for (const BreakThrough& b : f.break_throughs) {
    json made = describe(scene, facts, b.what);
    made.update({{"t_s", b.t_s},
                 {"plunge_m", b.plunge_m},
                 {"below_m", b.below_m},
                 {"lowest_t_s", b.lowest_t_s},
                 {"ended_t_s", b.ended_t_s},
                 {"ended_by", name_of(b.ended_by)}});
    out["break_throughs"].push_back(std::move(made));
  }
  out["break_throughs_count"] = f.break_throughs_count;
  out["plunge_max_m"] = f.plunge_max_m;
  out["tremor"] = {{"low_Hz", kTremorLow_Hz},
                   {"high_Hz", kTremorHigh_Hz},
                   {"settle_s", kTremorSettle_s},
                   {"free", describe(f.tremor_free)},
                   {"contact", describe(f.tremor_contact)}};
  json beside = json::array(), side_cuts = json::array();
  for (const Span& span : f.beside)
    beside.push_back({{"slice", span.slice < 0 ? json(nullptr) : json(span.slice)},
                      {"from_s", span.from_s},
                      {"to_s", span.to_s}});
  for (const Span& span : f.side_cuts)
    side_cuts.push_back({{"slice", span.slice}, {"t_s", span.from_s}});
  out["walls"] = {{"beside", std::move(beside)},
                  {"beside_count", f.beside_count},
                  {"beside_s", seconds(f.beside_ticks)},
                  {"side_cuts", std::move(side_cuts)},
                  {"side_cuts_count", f.side_cuts_count}};
  out["faults"] = json::array();
  for (const ReportFault& fault : f.faults) {
    const FaultWords& words = words_of(fault.fault);
    out["faults"].push_back({{"fault", words.name},
                             {"t_s", fault.t_s},
                             {"recovered_t_s", or_null(fault.recovered_s)},
                             {"message", fault_message(fault, facts)}});
  }
  out["faults_count"] = f.faults_count;
  out["goals"] = json::array();
  std::size_t met = 0;
  for (const GoalResult& goal : f.goals) {
    met += goal.met ? 1 : 0;
    out["goals"].push_back({{"goal", goal.goal},
                            {"zone", goal.zone.empty() ? json(nullptr) : json(goal.zone)},
                            {"limit", goal.limit},
                            {"limit_is", goal.at_least ? "least" : "largest"},
                            {"value", or_null(goal.value)},
                            {"unit", goal.unit},
                            {"met", goal.met},
                            {"how", goal.how}});
  }
  out["goals_met"] = met;
  out["samples"] = describe_samples(f);
  return json_text(out, 1);
}

}  // namespace trocar::runtime
