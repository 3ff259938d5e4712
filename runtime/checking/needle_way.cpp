// SPDX-License-Identifier: Apache-2.0
#include "runtime/checking/needle_way.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>

#include "formats/base/text_line.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;

constexpr double kSame_mm = 0.05;     // a height this far above a point counts as its own
constexpr double kLeastDepth_mm = 1;  // of a target below the entry

/// Returns a point of the patient in the frame of the levels, by the level that is nearest to it.
Vector3d in_levels(const std::vector<Level>& levels, const std::array<double, 3>& lps_mm) {
  Vector3d nearest = Vector3d::Constant(std::numeric_limits<double>::infinity());
  double z_mm = 0;
  for (const Level& level : levels) {
    const Vector3d at = level.slice->T_lps_plane.inverse() * Vector3d(lps_mm.data());
    if (std::abs(at.z()) >= std::abs(nearest.z())) continue;
    nearest = at;
    z_mm = level.z_mm;
  }
  return {nearest.x(), nearest.y(), z_mm + nearest.z()};
}

bool is_in_material(const Level& level, double step_mm, const Vector3d& at_mm) {
  const SliceMesh& mesh = level.slice->mesh;
  const double x = at_mm.x() / step_mm, y = at_mm.y() / step_mm;
  return std::any_of(mesh.triangles.begin(), mesh.triangles.end(), [&](const Triangle& triangle) {
    for (std::size_t k = 0; k < 3; ++k) {
      const LatticePoint a = mesh.vertices[triangle[k]], b = mesh.vertices[triangle[(k + 1) % 3]];
      const double side =
          (static_cast<double>(b.x) - static_cast<double>(a.x)) * (y - static_cast<double>(a.y)) -
          (static_cast<double>(b.y) - static_cast<double>(a.y)) * (x - static_cast<double>(a.x));
      if (side < 0) return false;
    }
    return true;
  });
}

std::string name_point(const char* what, const std::array<double, 3>& lps_mm) {
  return text_line("the %s (%.1f, %.1f, %.1f) mm", what, lps_mm[0], lps_mm[1], lps_mm[2]);
}

/// Finds the levels of the bone that the way enters. Returns the reason if there is no such bone, else an empty text.
std::string find_entry(const std::vector<Level>& levels, double entry_z_mm, NeedleWay& way) {
  const std::size_t count = levels.size();
  std::size_t at = 0;
  while (at < count && levels[at].z_mm > entry_z_mm + kSame_mm)
    ++at;
  while (at < count && way.is_clear[at] == 0)
    ++at;
  if (at == count) return "the needle meets no bone there: choose another entry";
  while (at > 0 && way.is_clear[at - 1] != 0)
    --at;
  for (std::size_t i = 0; i < at; ++i) {
    if (way.is_clear[i] != 0)
      return "the needle would first go through the bone of slice " +
             std::to_string(levels[i].slice->index) +
             ", which lies above it: choose an entry there, or another direction";
  }
  way.first = at;
  return {};
}

/// Returns the last level of a way without a target.
std::size_t find_end(const std::vector<Level>& levels, const NeedleWay& way, double height_mm,
                     double max_gap_mm) {
  std::size_t last = way.first;
  for (std::size_t i = way.first + 1; i < levels.size(); ++i) {
    if (levels[way.first].z_mm - levels[i].z_mm > height_mm) break;
    if (levels[i - 1].z_mm - levels[i].z_mm > max_gap_mm) break;
    if (way.is_clear[i] != 0) last = i;
  }
  return last;
}

}  // namespace

NeedleWay way_through(const EntryColumn& column, const std::vector<Level>& levels) {
  NeedleWay way;
  const auto rounded = [](double mm) { return std::round(mm * 100) / 100; };
  way.entry_mm = {rounded(column.at_mm[0]), rounded(column.at_mm[1]), levels[column.first].z_mm};
  way.first = column.first;
  way.last = column.last;
  way.end_mm = point_at(way, levels[column.last].z_mm);
  way.thickness_mm = column.thickness_mm;
  way.is_clear = column.is_clear;
  return way;
}

Result<NeedleWay> plan_needle_way(const Asset& asset, const std::vector<Level>& levels,
                                  const ChosenPoints& points, double height_mm, double max_gap_mm) {
  NeedleWay way;
  const Vector3d chosen = in_levels(levels, points.entry_mm);
  way.entry_mm = chosen;
  if (points.target_mm) {
    way.has_target = true;
    way.end_mm = in_levels(levels, *points.target_mm);
    if (!(chosen.z() - way.end_mm.z() >= kLeastDepth_mm))
      return refused(
          name_point("target", *points.target_mm) +
          text_line(" is not below the entry in the stack, by at least %.0f mm: the needle goes "
                    "from the last slices to the first",
                    kLeastDepth_mm));
    way.direction = (way.end_mm - chosen).normalized();
  }
  const double step_mm = asset.lattice.step_mm();
  for (const Level& level : levels)
    way.is_clear.push_back(is_in_material(level, step_mm, point_at(way, level.z_mm)) ? 1 : 0);
  if (const std::string why = find_entry(levels, chosen.z(), way); !why.empty())
    return refused(name_point("entry", points.entry_mm) + ": " + why);
  const double top_mm = levels[way.first].z_mm;
  // The surface of bone lies up to half a gap above its topmost level.
  const double gap_mm = way.first > 0 ? levels[way.first - 1].z_mm - top_mm : 0;
  if (chosen.z() < top_mm || chosen.z() > top_mm + gap_mm) way.entry_mm = point_at(way, top_mm);
  way.moved_mm = (way.entry_mm - chosen).norm();
  if (way.has_target) {
    if (!(way.end_mm.z() < top_mm))
      return refused(name_point("target", *points.target_mm) + " lies above the bone on its way");
    way.last = way.first;
    while (way.last + 1 < levels.size() && levels[way.last + 1].z_mm >= way.end_mm.z())
      ++way.last;
  } else {
    way.last = find_end(levels, way, height_mm, max_gap_mm);
    way.end_mm = point_at(way, levels[way.last].z_mm);
  }
  const std::vector<double> thickness_mm = level_thickness(levels, max_gap_mm);
  for (std::size_t i = way.first; i <= way.last; ++i) {
    way.thickness_mm += way.is_clear[i] != 0 ? thickness_mm[i] / -way.direction.z() : 0;
    if (i > way.first)
      way.max_gap_mm = std::max(way.max_gap_mm, levels[i - 1].z_mm - levels[i].z_mm);
  }
  return way;
}

Vector3d point_at(const NeedleWay& way, double z_mm) {
  return way.entry_mm + (z_mm - way.entry_mm.z()) / way.direction.z() * way.direction;
}

double tilt_deg(const NeedleWay& way) {
  return std::acos(std::clamp(-way.direction.z(), -1.0, 1.0)) * 180 / std::numbers::pi;
}

}  // namespace trocar::runtime
