// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "formats/base/json_text.h"
#include "formats/geometry/slice_mesh.h"
#include "formats/session/scene_reading/scene_readers.h"

namespace trocar {
namespace {

// The corners as lattice points with a step of one nanometre, so that the exact predicates can be
// used.
Ring in_nm(std::span<const std::array<double, 2>> polygon_m) {
  Ring ring;
  for (const auto& [x_m, y_m] : polygon_m)
    ring.push_back({static_cast<std::int32_t>(std::lrint(x_m * 1e9)),
                    static_cast<std::int32_t>(std::lrint(y_m * 1e9))});
  return ring;
}

bool is_simple(const Ring& ring) {
  const std::size_t n = ring.size();
  for (std::size_t i = 0; i < n; ++i) {
    if (ring[i] == ring[(i + 1) % n]) return false;
    for (std::size_t j = i + 1; j < n; ++j) {
      if (segments_cross(ring[i], ring[(i + 1) % n], ring[j], ring[(j + 1) % n])) return false;
      if (j > i + 1 && ring[i] == ring[j]) return false;
    }
  }
  return true;
}

using Point = std::array<double, 3>;

void read_point(StrictObject& object, const char* key, Point& point_m) {
  object.numbers(key, point_m, -kMaxPosition_m, kMaxPosition_m, true);
}

// Sets the line's direction to the unit vector of `way`; false if that has no length.
bool set_direction(const Point& way, PlannedLine& line) {
  constexpr double kMinLength = 1e-6;
  const double length = std::hypot(way[0], way[1], way[2]);
  for (std::size_t k = 0; k < 3; ++k)
    line.direction[k] = way[k] / length;
  return length >= kMinLength;
}

// The direction is given, or leads from the entry to `to_m` or to the target.
void read_line(StrictObject& object, const SceneGoals& goals, PlannedLine& line) {
  read_point(object, "entry_m", line.entry_m);
  if (object.has("direction") && object.has("to_m")) object.error("has both direction and to_m");
  Point way{};
  if (object.has("direction")) {
    read_point(object, "direction", way);
    if (!set_direction(way, line)) object.error("direction", "has no direction");
  } else if (object.has("to_m") || goals.target) {
    if (goals.target) way = goals.target->at_m;
    object.numbers("to_m", way, -kMaxPosition_m, kMaxPosition_m, false);
    for (std::size_t k = 0; k < 3; ++k)
      way[k] -= line.entry_m[k];
    if (!set_direction(way, line)) object.error("has no direction");
  } else {
    object.error("must have direction or to_m, or the goals must have a target");
  }
  object.read("entry_radius_m", line.entry_radius_m, 1e-5, 1.0);
  object.read("corridor_m", line.corridor_m, 1e-5, 1.0);
}

void read_capsule(StrictObject& object, ForbiddenZone& zone) {
  zone.shape = ForbiddenZone::Shape::kCapsule;
  read_point(object, "from_m", zone.low_m);
  read_point(object, "to_m", zone.high_m);
  zone.radius_m = object.number("radius_m", 1e-5, kMaxPosition_m);
}

void read_box(StrictObject& object, ForbiddenZone& zone) {
  zone.shape = ForbiddenZone::Shape::kBox;
  read_point(object, "min_m", zone.low_m);
  read_point(object, "max_m", zone.high_m);
  for (std::size_t k = 0; k < 3; ++k) {
    if (!(zone.low_m[k] < zone.high_m[k])) object.error("max_m", "must be above min_m");
  }
}

void read_prism(StrictObject& object, ForbiddenZone& zone) {
  zone.shape = ForbiddenZone::Shape::kPrism;
  object.numbers("z_m", zone.z_m, -kMaxPosition_m, kMaxPosition_m, true);
  if (!(zone.z_m[0] < zone.z_m[1])) object.error("z_m", "must be [lowest, highest]");
  zone.outline_m = read_polygon(object, "outline_m", kMaxZoneCorners, kMaxPosition_m);
}

void read_zone(StrictObject& object, ForbiddenZone& zone) {
  zone.name = object.string("name");
  object.read("margin_m", zone.margin_m, 0.0, 0.1);
  int shapes = 0;
  const auto read = [&](const char* key, auto&& reader) {
    shapes += object.section(key, [&](StrictObject& shape) { reader(shape, zone); }) ? 1 : 0;
  };
  read("capsule", read_capsule);
  read("box", read_box);
  read("prism", read_prism);
  if (shapes != 1) object.error("must have one of capsule, box and prism");
}

}  // namespace

std::vector<std::array<double, 2>> read_polygon(StrictObject& object, const char* key,
                                                std::size_t max_corners, double max_m) {
  std::vector<std::array<double, 2>> polygon_m;
  const nlohmann::json* list = object.array(key, 3, max_corners);
  for (std::size_t i = 0; list != nullptr && i < list->size(); ++i) {
    const nlohmann::json& corner = (*list)[i];
    const bool is_pair =
        corner.is_array() && corner.size() == 2 && corner[0].is_number() && corner[1].is_number();
    if (is_pair) polygon_m.push_back({corner[0].get<double>(), corner[1].get<double>()});
    if (!is_pair || !(std::abs(polygon_m[i][0]) <= max_m && std::abs(polygon_m[i][1]) <= max_m)) {
      const std::string max = json_text(max_m);
      std::string reason = "must be pairs of numbers within -";
      reason.append(max).append(" and ").append(max);
      object.error(key, reason);
      return {};
    }
  }
  const Ring ring = in_nm(polygon_m);
  if (list != nullptr && (!is_simple(ring) || doubled_area(ring) == 0))
    object.error(key, "must be a simple polygon");
  return polygon_m;
}

bool is_clockwise(std::span<const std::array<double, 2>> polygon_m) {
  return doubled_area(in_nm(polygon_m)) < 0;
}

void read_goals(StrictObject& object, SceneGoals& goals) {
  object.section("target", [&](StrictObject& target) {
    GoalTarget& out = goals.target.emplace();
    read_point(target, "at_m", out.at_m);
    out.radius_m = target.number("radius_m", 1e-5, kMaxPosition_m);
  });
  object.section("line", [&](StrictObject& line) { read_line(line, goals, goals.line.emplace()); });
  object.read("force_max_N", goals.force_max_N, 0.01, 1000.0);
  object.read("time_max_s", goals.time_max_s, 1e-3, kMaxDuration_s);
  object.read("plunge_max_m", goals.plunge_max_m, 1e-5, 1.0);
  if (!object.has("zones")) return;
  object.elements("zones", 1, kMaxZones, [&](StrictObject& zone) {
    read_zone(zone, goals.zones.emplace_back());
    check_last_name(goals.zones, zone);
  });
}

}  // namespace trocar
