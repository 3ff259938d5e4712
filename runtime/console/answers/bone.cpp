// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/answers/bone.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/base/file_io.h"
#include "formats/base/json_text.h"
#include "runtime/console/answers/container.h"
#include "runtime/console/answers/placed_bone.h"
#include "runtime/contact/sheet.h"
#include "runtime/contact/tool.h"
#include "runtime/device/pose.h"

namespace trocar::runtime {
namespace {

double squared(double value) {
  return value * value;
}

using nlohmann::json;

void add_triangles(const AssetSurface& surface, std::size_t first_vertex,
                   std::vector<std::uint32_t>& triangles) {
  for (const auto& triangle : surface.surface.triangles) {
    for (const std::uint32_t v : triangle)
      triangles.push_back(static_cast<std::uint32_t>(first_vertex) + v);
  }
}

/// Finds the HU of the nearest vertex of a scan's slices. Positions are in the plane of
/// the topmost sheet.
class NearestHu {
 public:
  NearestHu(const std::vector<AssetSlice>& slices, const Lattice& lattice,
            const Eigen::Affine3d& T_plane_lps) {
    for (const AssetSlice& slice : slices) {
      if (slice.hu.empty() || slice.hu.size() != slice.mesh.vertices.size()) continue;
      const Eigen::Affine3d T_plane_slice = T_plane_lps * slice.T_lps_plane;
      Layer& layer = layers_[T_plane_slice.translation().z()];
      for (std::size_t v = 0; v < slice.hu.size(); ++v) {
        const LatticePoint p = slice.mesh.vertices[v];
        const Eigen::Vector3d at =
            T_plane_slice * Eigen::Vector3d(lattice.to_mm(p.x), lattice.to_mm(p.y), 0);
        layer[cell(at.x(), at.y())].push_back({at.x(), at.y(), slice.hu[v]});
      }
    }
  }
  bool is_empty() const { return layers_.empty(); }

  float at(const Eigen::Vector3d& p) const {
    auto above = layers_.lower_bound(p.z());
    if (above == layers_.end() ||
        (above != layers_.begin() && p.z() - std::prev(above)->first < above->first - p.z()))
      --above;
    const auto [i, j] = cell(p.x(), p.y());
    constexpr int kMaxRing = 8;
    float hu = 0;
    double nearest = -1;
    for (int ring = 0; ring <= kMaxRing; ++ring) {
      // A vertex of the next ring cannot be nearer than this ring's inner side.
      if (nearest >= 0 && nearest <= squared((ring - 1) * kCell_mm)) break;
      for (int di = -ring; di <= ring; ++di) {
        const int step = std::abs(di) == ring || ring == 0 ? 1 : 2 * ring;
        for (int dj = -ring; dj <= ring; dj += step) {
          const auto found = above->second.find({i + di, j + dj});
          if (found == above->second.end()) continue;
          for (const Sample& sample : found->second) {
            const double distance = squared(sample.u - p.x()) + squared(sample.v - p.y());
            if (nearest >= 0 && distance >= nearest) continue;
            nearest = distance;
            hu = sample.hu;
          }
        }
      }
    }
    return hu;
  }

 private:
  static constexpr double kCell_mm = 2;
  struct Sample {
    double u, v;
    float hu;
  };
  using Cell = std::pair<int, int>;
  using Layer = std::map<Cell, std::vector<Sample>>;
  static Cell cell(double u, double v) {
    // Coordinates of an asset are within 2^24 mm, so the indices fit.
    return {static_cast<int>(std::floor(u / kCell_mm)), static_cast<int>(std::floor(v / kCell_mm))};
  }
  std::map<double, Layer> layers_;
};

json describe_surface(const PlacedBone& loaded, Arrays& arrays) {
  if (loaded.surfaces.empty()) return nullptr;
  const auto T_plane_lps = plane_of_surface(loaded);
  if (!T_plane_lps) return nullptr;
  const Sheet& top = *loaded.sheets.front();
  const NearestHu field(loaded.all, loaded.asset.lattice, *T_plane_lps);
  std::vector<float> vertices, hu;
  std::vector<std::uint32_t> triangles;
  for (const AssetSurface& one : loaded.surfaces) {
    add_triangles(one, vertices.size() / 3, triangles);
    const double step_mm = one.surface.lattice.step_mm();
    for (const SpacePoint& p : one.surface.vertices) {
      const Eigen::Vector3d at = *T_plane_lps * (Eigen::Vector3d(p[0], p[1], p[2]) * step_mm);
      const Eigen::Vector2d xy =
          top.transform.to_scene(at.head<2>() / top.transform.lattice.step_mm());
      for (const double x : {xy.x(), xy.y(), top.z_m + at.z() * 1e-3})
        vertices.push_back(static_cast<float>(x));
      if (!field.is_empty()) hu.push_back(field.at(at));
    }
  }
  return {{"vertices", arrays.add(vertices)},
          {"triangles", arrays.add(triangles)},
          {"hu", field.is_empty() ? json() : json(arrays.add(hu))}};
}

json describe_sheet(const Sheet& sheet, const Asset& asset, Arrays& arrays) {
  const AssetSlice& slice = slice_of(asset, sheet.slice_index);
  std::vector<float> vertices;
  std::vector<std::uint32_t> triangles;
  for (const LatticePoint p : slice.mesh.vertices) {
    const Eigen::Vector2d at =
        sheet.transform.to_scene({static_cast<double>(p.x), static_cast<double>(p.y)});
    vertices.push_back(static_cast<float>(at.x()));
    vertices.push_back(static_cast<float>(at.y()));
  }
  for (const Triangle& triangle : slice.mesh.triangles)
    triangles.insert(triangles.end(), triangle.begin(), triangle.end());
  const bool has_hu = !slice.hu.empty() && slice.hu.size() == slice.mesh.vertices.size();
  return {{"slice", sheet.slice_index},
          {"z_m", sheet.z_m},
          {"vertices", arrays.add(vertices)},
          {"triangles", arrays.add(triangles)},
          {"hu", has_hu ? json(arrays.add(slice.hu)) : json()}};
}

json describe_tool(const SceneTool& scene_tool) {
  const Tool tool = make_tool(scene_tool);
  // The axes of the cross-section are those of the plate, tilted with the tool.
  const Eigen::Quaterniond tilt = rotation_from_z(tool.axis_plate);
  json outline = json::array(), corners = json::array();
  double radius_m = 0;
  for (int i = 0; i < tool.sides; ++i) {
    const Eigen::Vector3d& corner = tool.corner_plate_m[static_cast<std::size_t>(i)];
    const Eigen::Vector3d across = tilt.inverse() * (corner - tool.tip_plate_m);
    outline.push_back({across.x(), across.y()});
    corners.push_back({corner.x(), corner.y(), corner.z()});
    radius_m = std::max(radius_m, across.head<2>().norm());
  }
  return {{"outline_m", outline},
          {"corners_in_plate_m", corners},
          {"tip_in_plate_m", scene_tool.tip_in_plate_m},
          {"axis_in_plate", {tool.axis_plate.x(), tool.axis_plate.y(), tool.axis_plate.z()}},
          {"radius_m", radius_m}};
}

/// Returns the rows of the transform from {B} (m) to the patient's frame (LPS, mm); null if the slices do not lie relative to
/// each other as in the scan.
json patient_of_device(const PlacedBone& loaded) {
  const auto T_device_lps = device_of_patient(loaded);
  if (!T_device_lps) return nullptr;
  const Eigen::Affine3d T_lps_device = T_device_lps->inverse();
  json rows = json::array();
  for (int row = 0; row < 3; ++row)
    rows.push_back(
        {T_lps_device(row, 0), T_lps_device(row, 1), T_lps_device(row, 2), T_lps_device(row, 3)});
  return rows;
}

/// Returns the goals as they are written in the scene; null if it has none.
json goals_of(const std::filesystem::path& scene_file) {
  const auto bytes = read_file(scene_file, std::uint64_t{4} << 20);
  if (!bytes) return nullptr;
  const json scene = parse_json(*bytes);
  return scene.is_object() && scene.contains("goals") ? scene["goals"] : json();
}

}  // namespace

Result<std::string> bone_of(const std::filesystem::path& scene_file,
                            const std::filesystem::path& asset) {
  const Result<PlacedBone> loaded = load_bone(scene_file, asset, BoneParts::kForView);
  if (!loaded) return loaded.error();
  Arrays arrays;
  json slices = json::array();
  for (const auto& sheet : loaded->sheets)
    slices.push_back(describe_sheet(*sheet, loaded->asset, arrays));
  const json head = {
      {"schema", "trocar.bone/1"},     {"surface", describe_surface(*loaded, arrays)},
      {"slices", std::move(slices)},   {"tool", describe_tool(loaded->scene.tool)},
      {"goals", goals_of(scene_file)}, {"lps_mm_of_device", patient_of_device(*loaded)}};
  return arrays.with_json(json_text(head));
}

Result<PatientBone> patient_bone_of(const std::filesystem::path& scene_file,
                                    const std::filesystem::path& asset) {
  const Result<PlacedBone> loaded = load_bone(scene_file, asset, BoneParts::kForView);
  if (!loaded) return loaded.error();
  PatientBone bone;
  const auto T_device_lps = device_of_patient(*loaded);
  if (!T_device_lps) return bone;
  // DICOM's LPS and RAS differ by the signs of x and y, and {B} is in m.
  bone.T_patient_device =
      Eigen::Scaling(-1.0, -1.0, 1.0) * T_device_lps->inverse() * Eigen::Scaling(1e-3);
  for (const AssetSurface& one : loaded->surfaces) {
    add_triangles(one, bone.vertices_mm.size() / 3, bone.triangles);
    const double step_mm = one.surface.lattice.step_mm();
    for (const SpacePoint& p : one.surface.vertices) {
      for (const double x : {-step_mm * p[0], -step_mm * p[1], step_mm * p[2]})
        bone.vertices_mm.push_back(static_cast<float>(x));
    }
  }
  return bone;
}

}  // namespace trocar::runtime
