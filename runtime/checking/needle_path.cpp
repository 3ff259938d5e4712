// SPDX-License-Identifier: Apache-2.0
#include "runtime/checking/needle_path.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>

#include "formats/base/text_line.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;

constexpr double kSame_mm = 0.15;     // a height this far above a point counts as its own
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

/// Returns whether the slices lie straight above each other, so that what is straight in the frame of the levels is so in the
/// patient.
bool is_straight(const std::vector<Level>& levels) {
  constexpr double kMaxAside_mm = 0.02, kMaxTurned = 1e-4;
  const Eigen::Affine3d T_first_lps = levels.front().slice->T_lps_plane.inverse();
  return std::all_of(levels.begin(), levels.end(), [&](const Level& level) {
    const Eigen::Affine3d between = T_first_lps * level.slice->T_lps_plane;
    return between.linear().isIdentity(kMaxTurned) &&
           between.translation().head<2>().norm() <= kMaxAside_mm;
  });
}

/// Returns whether no slice without material lies between a level and the next one.
bool is_next(const std::vector<Level>& levels, std::size_t above) {
  return std::abs(levels[above].slice->index - levels[above + 1].slice->index) == 1;
}

/// Returns the distance of a level from its neighbours; 0: it has none.
double spacing_at(const std::vector<Level>& levels, std::size_t at) {
  if (at + 1 < levels.size() && is_next(levels, at)) return levels[at].z_mm - levels[at + 1].z_mm;
  if (at > 0 && is_next(levels, at - 1)) return levels[at - 1].z_mm - levels[at].z_mm;
  return 0;
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

/// Finds the levels of the bone that the path enters. Returns the reason if there is no such bone, else an empty text.
std::string find_entry(const std::vector<Level>& levels, double entry_z_mm, NeedlePath& path) {
  const std::size_t count = levels.size();
  std::size_t at = 0;
  while (at < count && levels[at].z_mm > entry_z_mm + kSame_mm)
    ++at;
  while (at < count && path.has_material[at] == 0)
    ++at;
  if (at == count) return "the needle meets no bone there: choose another entry";
  while (at > 0 && path.has_material[at - 1] != 0 && is_next(levels, at - 1))
    --at;
  for (std::size_t i = 0; i < at; ++i) {
    if (path.has_material[i] != 0)
      return "the needle would first go through the bone of slice " +
             std::to_string(levels[i].slice->index) +
             ", which lies above it: choose an entry there, or another direction";
  }
  path.first = at;
  return {};
}

/// Returns the last level of a path without a target.
std::size_t find_end(const std::vector<Level>& levels, const NeedlePath& path,
                     const PathLimits& limits) {
  std::size_t last = path.first;
  for (std::size_t i = path.first + 1; i < levels.size(); ++i) {
    if (levels[path.first].z_mm - levels[i].z_mm > limits.height_mm) break;
    if (levels[i - 1].z_mm - levels[i].z_mm > limits.gap_mm) break;
    if (slices_between(levels[path.first], levels[i]) > limits.slices) break;
    if (path.has_material[i] == 0) continue;
    if (gap_mm(levels[last], levels[i]) / -path.direction.z() > kMaxBoneGap_mm) break;
    last = i;
  }
  return last;
}

}  // namespace

NeedlePath path_through(const EntryColumn& column, const std::vector<Level>& levels) {
  NeedlePath path;
  const auto rounded = [](double mm) { return std::round(mm * 100) / 100; };
  path.entry_mm = {rounded(column.at_mm[0]), rounded(column.at_mm[1]), levels[column.first].z_mm};
  path.first = column.first;
  path.last = column.last;
  path.end_mm = point_at(path, levels[column.last].z_mm);
  path.thickness_mm = column.thickness_mm;
  path.has_material = column.has_material;
  return path;
}

Result<NeedlePath> plan_needle_path(const Asset& asset, const std::vector<Level>& levels,
                                    const ChosenPoints& points, const PathLimits& limits) {
  NeedlePath path;
  if (!is_straight(levels))
    return refused(
        "its slices do not lie straight above each other, as with a tilted gantry: no straight "
        "path "
        "can be planned through them");
  const Vector3d chosen = in_levels(levels, points.entry_mm);
  path.entry_mm = chosen;
  if (points.target_mm) {
    path.has_target = true;
    path.end_mm = in_levels(levels, *points.target_mm);
    if (!(chosen.z() - path.end_mm.z() >= kLeastDepth_mm))
      return refused(
          name_point("target", *points.target_mm) +
          text_line(" is not below the entry in the stack, by at least %.0f mm: the needle goes "
                    "from the last slices to the first",
                    kLeastDepth_mm));
    path.direction = (path.end_mm - chosen).normalized();
  }
  const double step_mm = asset.lattice.step_mm();
  for (const Level& level : levels)
    path.has_material.push_back(is_in_material(level, step_mm, point_at(path, level.z_mm)) ? 1 : 0);
  if (const std::string why = find_entry(levels, chosen.z(), path); !why.empty())
    return refused(name_point("entry", points.entry_mm) + ": " + why);
  const double top_mm = levels[path.first].z_mm;
  // The surface of bone lies up to half a slice above its topmost level.
  const double surface_mm = top_mm + spacing_at(levels, path.first) / 2;
  if (chosen.z() < top_mm || chosen.z() > surface_mm + kSame_mm)
    path.entry_mm = point_at(path, top_mm);
  path.entry_shift_mm = (path.entry_mm - chosen).norm();
  if (path.has_target) {
    if (!(path.end_mm.z() < top_mm))
      return refused(name_point("target", *points.target_mm) + " lies above the bone on its path");
    path.last = path.first;
    while (path.last + 1 < levels.size() && levels[path.last + 1].z_mm >= path.end_mm.z())
      ++path.last;
  } else {
    path.last = find_end(levels, path, limits);
    path.end_mm = point_at(path, levels[path.last].z_mm);
  }
  const std::vector<double> thickness_mm = level_thickness(levels, limits.gap_mm);
  for (std::size_t i = path.first; i <= path.last; ++i) {
    path.thickness_mm += path.has_material[i] != 0 ? thickness_mm[i] / -path.direction.z() : 0;
    if (i > path.first)
      path.max_gap_mm = std::max(path.max_gap_mm, levels[i - 1].z_mm - levels[i].z_mm);
  }
  return path;
}

std::vector<BoneGap> bone_gaps(const std::vector<Level>& levels, const NeedlePath& path) {
  std::vector<BoneGap> gaps;
  std::size_t above = path.first;
  for (std::size_t i = path.first + 1; i < levels.size(); ++i) {
    if (path.has_material[i] == 0) continue;
    const double mm = gap_mm(levels[above], levels[i]) / -path.direction.z();
    if (mm > kMaxBoneGap_mm) gaps.push_back({above, i, mm});
    if (i > path.last) break;
    above = i;
  }
  return gaps;
}

Vector3d point_at(const NeedlePath& path, double z_mm) {
  return path.entry_mm + (z_mm - path.entry_mm.z()) / path.direction.z() * path.direction;
}

double tilt_deg(const NeedlePath& path) {
  return std::acos(std::clamp(-path.direction.z(), -1.0, 1.0)) * 180 / std::numbers::pi;
}

}  // namespace trocar::runtime
