// SPDX-License-Identifier: Apache-2.0
#include "runtime/reporting/goal_meter.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "runtime/reporting/vector3.h"

namespace trocar::runtime {
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

}  // namespace trocar::runtime
