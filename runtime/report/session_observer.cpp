// SPDX-License-Identifier: Apache-2.0
#include "runtime/report/session_observer.h"

namespace trocar::runtime {

std::vector<std::array<double, 2>> material_along(const Sheet& sheet, int axis, double at_m) {
  std::vector<std::array<double, 2>> intervals;
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
    if (low_m < high_m) intervals.push_back({low_m, high_m});
  }
  std::sort(intervals.begin(), intervals.end());
  constexpr double kJoined_m = 1e-5;
  std::vector<std::array<double, 2>> joined;
  for (const std::array<double, 2>& interval : intervals) {
    if (!joined.empty() && interval[0] <= joined.back()[1] + kJoined_m)
      joined.back()[1] = std::max(joined.back()[1], interval[1]);
    else
      joined.push_back(interval);
  }
  return joined;
}

namespace {

/// Returns the distance from a polygon's border in its plane, negative inside.
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

/// A zone is a volume in which the tip must not be. Returns the distance in m of a point from a
/// zone; negative: the point is inside the zone.
double zone_distance_m(const ForbiddenZone& zone, const Vector3& p_m) {
  if (zone.shape == ForbiddenZone::Shape::kCapsule) {
    const Vector3 way = minus(zone.high_m, zone.low_m), from = minus(p_m, zone.low_m);
    const double square = dot(way, way);
    const double along = square > 0 ? std::clamp(dot(from, way) / square, 0.0, 1.0) : 0;
    return length({from[0] - along * way[0], from[1] - along * way[1], from[2] - along * way[2]}) -
           zone.radius_m;
  }
  // The distance beyond each pair of sides of a box, or beyond the outline and the two ends
  // of a prism.
  Vector3 beyond{};
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

std::optional<Punctured> punctured_at(const ResistanceFall& found) {
  if (found.layer >= 0) return Punctured{true, static_cast<std::size_t>(found.layer)};
  if (found.sheet >= 0) return Punctured{false, static_cast<std::size_t>(found.sheet)};
  return std::nullopt;
}

constexpr double kFar = std::numeric_limits<double>::infinity();

/// The material of a sheet in {B}: its triangles, and the edges of its outline.
struct Material {
  double z_m = 0;
  std::vector<std::array<Eigen::Vector2d, 3>> triangles;
  std::vector<std::array<Eigen::Vector2d, 2>> edges;
};

double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

Material material_of(const Sheet& sheet) {
  Material out;
  out.z_m = sheet.z_m;
  for (std::uint32_t t = 0; t < sheet.mesh.triangles.size(); ++t) {
    if (!sheet.mesh.in_use(t)) continue;
    std::array<Eigen::Vector2d, 3> corner;
    for (std::size_t k = 0; k < 3; ++k) {
      const LatticePoint p = sheet.mesh.vertices[sheet.mesh.triangles[t][k]];
      corner[k] = sheet.transform.to_scene(
          Eigen::Vector2d(static_cast<double>(p.x), static_cast<double>(p.y)));
    }
    out.triangles.push_back(corner);
    for (std::size_t k = 0; k < 3; ++k) {
      if (sheet.mesh.across[t][k] == kNoSlot) out.edges.push_back({corner[k], corner[(k + 1) % 3]});
    }
  }
  return out;
}

bool is_over(const Material& material, const Eigen::Vector2d& p) {
  return std::any_of(material.triangles.begin(), material.triangles.end(), [&](const auto& c) {
    return cross(c[1] - c[0], p - c[0]) >= 0 && cross(c[2] - c[1], p - c[1]) >= 0 &&
           cross(c[0] - c[2], p - c[2]) >= 0;
  });
}

double distance_m(const Material& material, const Eigen::Vector2d& p) {
  if (is_over(material, p)) return 0;
  double least = kFar;
  for (const auto& [a, b] : material.edges) {
    const Eigen::Vector2d way = b - a;
    const double along = std::clamp((p - a).dot(way) / way.squaredNorm(), 0.0, 1.0);
    least = std::min(least, (p - a - along * way).squaredNorm());
  }
  return std::sqrt(least);
}

/// Distance of a point in the plane of bone[at] to the material of all slices.
double distance_m(const std::vector<Material>& bone, std::size_t at, const Eigen::Vector2d& p) {
  double least = distance_m(bone[at], p);
  for (const Material& other : bone) {
    const double apart = std::abs(other.z_m - bone[at].z_m);
    if (apart < least) least = std::min(least, std::hypot(apart, distance_m(other, p)));
  }
  return least;
}

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

void GoalMeter::observe(const RecordingRow& row, SessionFigures& figures) {
  if (goals_.target) {
    const double away_m = length(minus(row.tool_m, goals_.target->at_m));
    if (!figures.target_m || away_m < *figures.target_m) {
      figures.target_m = away_m;
      figures.target_t_s = row.t_s;
    }
    if (!figures.target_reached_s && away_m <= goals_.target->radius_m)
      figures.target_reached_s = row.t_s;
  }
  if (goals_.line) observe_line(row, figures);
  for (std::size_t i = 0; i < goals_.zones.size(); ++i)
    observe_zone(i, row, figures.zones[i]);
}

void GoalMeter::observe_line(const RecordingRow& row, SessionFigures& figures) const {
  const Vector3 from = minus(row.tool_m, goals_.line->entry_m);
  const Vector3& d = goals_.line->direction;
  const double along = dot(from, d);
  if (along < 0) return;
  const double away_m =
      length({from[0] - along * d[0], from[1] - along * d[1], from[2] - along * d[2]});
  if (figures.line_ticks++ == 0) figures.line_entry_m = away_m;
  figures.line_max_m = std::max(figures.line_max_m, away_m);
  figures.line_squares_m2 += away_m * away_m;
}

void GoalMeter::observe_zone(std::size_t index, const RecordingRow& row, ZoneFigures& figures) {
  const double away_m = zone_distance_m(goals_.zones[index], row.tool_m);
  if (!figures.min_m || away_m < *figures.min_m) {
    figures.min_m = away_m;
    figures.min_t_s = row.t_s;
  }
  const bool was_inside = in_zone_[index];
  in_zone_[index] = away_m < 0;
  if (away_m >= 0) return;
  if (!was_inside) figures.breaches.add({-1, row.t_s, row.t_s, 0, row.t_s});
  Span* const breach = figures.breaches.last();
  if (breach == nullptr) return;
  breach->to_s = row.t_s;
  if (-away_m > breach->depth_m) {
    breach->depth_m = -away_m;
    breach->depth_t_s = row.t_s;
  }
}

void GoalMeter::judge(SessionFigures& figures) const {
  const bool has_touched = figures.first_contact_s.has_value();
  const auto add = [&](bool attempted, GoalResult made) {
    made.attempted = attempted;
    made.met = attempted && made.value &&
               (made.at_least ? *made.value >= made.limit : *made.value <= made.limit);
    figures.goals.push_back(std::move(made));
  };
  if (goals_.target)
    add(has_touched || figures.target_reached_s,
        {"target", "", goals_.target->radius_m, false, figures.target_m, "m", false, false,
         "smallest distance of the tip to the target, at most its radius"});
  std::optional<double> entry_m, line_m;
  if (figures.line_ticks > 0) {
    entry_m = figures.line_entry_m;
    line_m = figures.line_max_m;
  }
  if (goals_.line && goals_.line->entry_radius_m)
    add(has_touched && entry_m,
        {"entry", "", *goals_.line->entry_radius_m, false, entry_m, "m", false, false,
         "distance of the tip to the planned line as it first passes the entry point, at most the "
         "entry radius"});
  if (goals_.line && goals_.line->corridor_m)
    add(has_touched && line_m,
        {"corridor", "", *goals_.line->corridor_m, false, line_m, "m", false, false,
         "largest distance of the tip to the planned line beyond the entry point, at most the "
         "corridor"});
  if (goals_.force_max_N)
    add(has_touched, {"force", "", *goals_.force_max_N, false, figures.force_max_N, "N", false,
                      false, "largest force on the hand, at most the ceiling"});
  if (goals_.time_max_s) {
    const std::optional<double> end_s =
        goals_.target ? figures.target_reached_s : figures.last_puncture_s;
    std::optional<double> took_s;
    if (figures.first_contact_s && end_s) took_s = std::max(0.0, *end_s - *figures.first_contact_s);
    add(has_touched,
        {"time", "", *goals_.time_max_s, false, took_s, "s", false, false,
         goals_.target
             ? "from the first contact until the tip is first within the target's radius, "
               "or 0 if it was so before the first contact"
             : "from the first contact until the last puncture"});
  }
  if (goals_.plunge_max_m)
    add(figures.break_throughs.count > 0 || figures.plunge_max_m > *goals_.plunge_max_m,
        {"plunge", "", *goals_.plunge_max_m, false, figures.plunge_max_m, "m", false, false,
         "largest plunge after a break-through, at most the limit"});
  for (std::size_t i = 0; i < goals_.zones.size(); ++i)
    add(has_touched || figures.zones[i].breaches.count > 0,
        {"zone", goals_.zones[i].name, goals_.zones[i].margin_m, true, figures.zones[i].min_m, "m",
         false, false,
         "smallest distance of the tip to the zone, at least its margin; negative: inside"});
}

double height_of(const Punctured& what, const Scene& scene,
                 const std::vector<ReportSheet>& sheets) {
  return what.is_layer ? scene.layers[what.index].top_z_m : sheets[what.index].z_m;
}

PlungeMeter::PlungeMeter(const Scene& scene, const std::vector<ReportSheet>& sheets, double rate_Hz)
    : scene_(scene), sheets_(sheets), max_ticks_(ticks_of(kPlunge_s, rate_Hz)) {}

void PlungeMeter::observe(const RecordingRow& row, const BreakThroughTick& tick,
                          SessionFigures& figures) {
  if (!tick.is_running) return end(PlungeEnd::kFault, row.t_s, figures);
  if (tick.comes_back) end(PlungeEnd::kReversed, row.t_s, figures);
  const double z_m = row.tool_m[2];
  // A fall that is a break-through, but began so long ago that it is not measured any more.
  const bool is_late = tick.found && (open_.empty() || open_.back().is_break_through);
  if (tick.begun || is_late) {
    const ResistanceFall& fall = tick.begun ? *tick.begun : *tick.found;
    Open& open = open_.emplace_back();
    open.made.plunge_m = fall.run_m;
    open.made.hand_m = fall.run_hand_m;
    open.reference_N = open.made.tip_N = fall.reference_N;
    open.made.lowest_t_s = row.t_s;
    open.lowest_z_m = z_m;
    open.ticks_left = max_ticks_;
  }
  if (tick.found) {
    Open& open = open_.back();
    open.is_break_through = true;
    open.made.what = punctured_at(*tick.found);
    open.made.t_s = row.t_s;
    open.ticks_left = max_ticks_;
  }
  std::erase_if(open_, [&](Open& open) {
    const double loss = loss_of_resistance(tick.force_N, open.reference_N);
    open.made.plunge_m += loss * tick.advance_m;
    open.made.hand_m += loss * tick.hand_m;
    if (z_m < open.lowest_z_m) open.made.lowest_t_s = row.t_s;
    open.lowest_z_m = std::min(open.lowest_z_m, z_m);
    if (open.ticks_left == 0) {
      close(open, PlungeEnd::kTime, row.t_s, figures);
      return true;
    }
    --open.ticks_left;
    return false;
  });
}

void PlungeMeter::end(PlungeEnd end, double t_s, SessionFigures& figures) {
  for (const Open& open : std::exchange(open_, {}))
    close(open, end, t_s, figures);
}

void PlungeMeter::close(const Open& open, PlungeEnd end, double t_s,
                        SessionFigures& figures) const {
  figures.plunge_max_m = std::max(figures.plunge_max_m, open.made.plunge_m);
  if (!open.is_break_through) return;
  BreakThrough made = open.made;
  if (made.what) {
    made.below_m = height_of(*made.what, scene_, sheets_) - open.lowest_z_m;
    if (made.what->is_layer) *made.below_m -= scene_.layers[made.what->index].thickness_m;
  }
  made.ended_by = end;
  made.ended_t_s = t_s;
  figures.break_throughs.add(made);
}

TremorMeter::TremorMeter(const Scene& scene, double rate_Hz)
    : axis_plate_(make_tool(scene.tool).axis_plate),
      settle_ticks_(ticks_of(kTremorSettle_s, rate_Hz)) {
  for (std::size_t i = 0; i < filter_.size(); ++i) {
    const bool is_high_pass = i == 0;
    const double w =
        2 * std::numbers::pi * (is_high_pass ? kTremorLow_Hz : kTremorHigh_Hz) / rate_Hz;
    const double cosine = std::cos(w), alpha = std::sin(w) / std::numbers::sqrt2;
    filter_[i].a = {1 + alpha, -2 * cosine, 1 - alpha};
    const double b = is_high_pass ? (1 + cosine) / 2 : (1 - cosine) / 2;
    filter_[i].b = {b, is_high_pass ? -(1 + cosine) : 1 - cosine, b};
  }
}

Vector3 TremorMeter::Filter::pass(const Vector3& in) noexcept {
  Vector3 out{};
  for (std::size_t k = 0; k < 3; ++k)
    out[k] =
        (b[0] * in[k] + b[1] * x[0][k] + b[2] * x[1][k] - a[1] * y[0][k] - a[2] * y[1][k]) / a[0];
  x = {in, x[0]};
  y = {out, y[0]};
  return out;
}

void TremorMeter::observe(const RecordingRow& row, SessionFigures& figures) {
  if (filtered_ == 0) {
    origin_ = row.tool_m;
    for (Filter& each : filter_)
      each.x = each.y = {};
  }
  const Vector3 passed = filter_[1].pass(filter_[0].pass(minus(row.tool_m, origin_)));
  if (filtered_++ < settle_ticks_) return;
  Tremor* tremor = row.phase == ContactPhase::kFree      ? &figures.tremor_free
                   : row.phase == ContactPhase::kContact ? &figures.tremor_contact
                                                         : nullptr;
  if (tremor == nullptr) return;
  ++tremor->ticks;
  const Eigen::Quaterniond q(row.q[0], row.q[1], row.q[2], row.q[3]);
  tremor->squares_m2 += (q * axis_plate_).cross(Eigen::Vector3d(passed.data())).squaredNorm();
}

std::optional<WallViolation> measure_wall_violation(std::span<const Sheet* const> sheets,
                                                    const Tool& tool,
                                                    const std::array<double, 3>& tip_m,
                                                    const std::array<double, 4>& q) {
  const Eigen::Vector3d tip(tip_m.data());
  const Eigen::Quaterniond turn(q[0], q[1], q[2], q[3]);
  const Pose T_device_plate{tip - turn * tool.tip_plate_m, turn};
  if (!is_upright(tool, T_device_plate)) return std::nullopt;
  const Eigen::Vector3d axis = turn * tool.axis_plate;
  std::vector<Material> bone;
  for (const Sheet* sheet : sheets)
    bone.push_back(material_of(*sheet));

  std::optional<double> begin_z_m;
  bool is_past_entry = false;
  WallViolation out;
  for (std::size_t i = 0; i < bone.size() && bone[i].z_m >= tip.z(); ++i) {
    const double z_m = bone[i].z_m;
    if (!begin_z_m && is_over(bone[i], axis_at(tool, T_device_plate, z_m).head<2>()))
      begin_z_m = z_m;
    if (!begin_z_m) continue;
    double outside_m = 0;
    for (int k = 0; k < tool.sides; ++k) {
      const Eigen::Vector3d corner =
          T_device_plate * tool.corner_plate_m[static_cast<std::size_t>(k)];
      const double up = (z_m - corner.z()) / axis.z();
      outside_m = std::max(outside_m, distance_m(bone, i, corner.head<2>() + up * axis.head<2>()));
    }
    is_past_entry = is_past_entry || outside_m == 0 || *begin_z_m - z_m > kEntry_m;
    if (!is_past_entry) continue;
    if (out.slices_judged++ == 0) out.first_slice = sheets[i]->slice_index;
    outside_m = std::round(outside_m * 1e9) / 1e9;
    if (outside_m <= out.outside_m) continue;
    out.outside_m = outside_m;
    out.slice = sheets[i]->slice_index;
  }
  return out.slices_judged > 0 ? std::optional(out) : std::nullopt;
}

int grade_of(double outside_m) {
  constexpr double kSmall_m = 2e-3, kLarge_m = 4e-3;
  if (outside_m <= 0) return 0;
  return outside_m < kSmall_m ? 1 : outside_m <= kLarge_m ? 2 : 3;
}

const char* words_of_grade(int grade) {
  constexpr std::array<const char*, 4> kWords = {"0", "under 2 mm", "2 to 4 mm", "over 4 mm"};
  return kWords[static_cast<std::size_t>(grade)];
}

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
  if (counts(row))
    observe_counted(tick, force_N);
  else
    observe_gap();
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
