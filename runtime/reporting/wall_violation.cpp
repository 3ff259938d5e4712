// SPDX-License-Identifier: Apache-2.0
#include "runtime/reporting/wall_violation.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace trocar::runtime {
namespace {

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

}  // namespace

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

}  // namespace trocar::runtime
