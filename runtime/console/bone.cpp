// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/bone.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/asset/one_sheet.h"
#include "formats/base/file_io.h"
#include "formats/base/json_text.h"
#include "formats/session/scene.h"
#include "runtime/console/container.h"
#include "runtime/console/files.h"
#include "runtime/contact/sheet.h"
#include "runtime/contact/tool.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;

constexpr std::uint64_t kMaxAssetBytes = std::uint64_t{1} << 30;
// Two slices lie relative to each other as in the scan if they differ from it by no more than this.
constexpr double kMaxAside_mm = 0.02, kMaxApart_m = 2e-5, kMaxTurned = 1e-4;

struct Loaded {
  Scene scene;
  Asset asset;  ///< contains only the scene's slices, with one mesh each
  std::vector<std::unique_ptr<const Sheet>> sheets;
  std::vector<AssetSurface> surfaces;
  std::vector<AssetSlice> all;  ///< the scan's slices with HU; empty without a surface
};

bool is_of_scene(const Scene& scene, int index) {
  return (scene.body && index >= scene.body->from && index <= scene.body->to) ||
         std::any_of(scene.slices.begin(), scene.slices.end(),
                     [index](const SceneSlice& slice) { return slice.index == index; });
}

Result<Loaded> load(const std::filesystem::path& scene_file, const std::filesystem::path& asset) {
  Loaded loaded;
  Result<Scene> scene = read_scene(scene_file);
  if (!scene) return scene.error();
  loaded.scene = std::move(*scene);
  if (!asset.empty()) loaded.scene.asset = asset;
  const std::string name = loaded.scene.asset.string();
  const Result<std::string> text = glb_json(loaded.scene.asset);
  if (!text) return text.error();
  if (has_surface(*text)) {
    const auto bytes = read_file(loaded.scene.asset, kMaxAssetBytes);
    if (!bytes) return bytes.error();
    Result<Asset> whole = decode_asset(*bytes, name);
    if (!whole) return whole.error();
    loaded.surfaces = std::move(whole->surfaces);
    loaded.asset = std::move(*whole);
    add_hu_at_vertices(loaded.asset);
    loaded.all = loaded.asset.slices;
    std::erase_if(loaded.asset.slices,
                  [&](const AssetSlice& slice) { return !is_of_scene(loaded.scene, slice.index); });
  } else {
    std::vector<int> indices;
    for (const SceneSlice& slice : loaded.scene.slices)
      indices.push_back(slice.index);
    if (const auto& body = loaded.scene.body) {
      for (int index = body->from; index <= body->to; ++index)
        indices.push_back(index);
    }
    Result<AssetPart> part = read_asset_part(loaded.scene.asset, std::move(indices));
    if (!part) return part.error();
    loaded.asset = std::move(part->asset);
    add_hu_at_vertices(loaded.asset);
  }
  if (const auto ok = weld_materials(loaded.asset, name); !ok) return ok.error();
  if (const auto ok = place_body(loaded.scene, loaded.asset, name); !ok) return ok.error();
  auto sheets = place_slices(loaded.scene, loaded.asset, name);
  if (!sheets) return sheets.error();
  loaded.sheets = std::move(*sheets);
  return loaded;
}

const AssetSlice& slice_of(const Asset& asset, int index) {
  return *std::find_if(asset.slices.begin(), asset.slices.end(),
                       [index](const AssetSlice& slice) { return slice.index == index; });
}

/// Returns the transform from the patient's frame to the plane of the topmost sheet (both in mm).
/// None: the sheets do not lie relative to each other as in the scan.
std::optional<Eigen::Affine3d> plane_of_surface(const Loaded& loaded) {
  const Sheet& top = *loaded.sheets.front();
  const Eigen::Affine3d T_plane_lps = slice_of(loaded.asset, top.slice_index).T_lps_plane.inverse();
  for (const auto& sheet : loaded.sheets) {
    const Eigen::Affine3d between =
        T_plane_lps * slice_of(loaded.asset, sheet->slice_index).T_lps_plane;
    const Eigen::Vector3d shift = between.translation();
    if (!between.linear().isIdentity(kMaxTurned) || !(shift.head<2>().norm() < kMaxAside_mm) ||
        !(std::abs(shift.z() * 1e-3 - (sheet->z_m - top.z_m)) < kMaxApart_m))
      return std::nullopt;
  }
  return T_plane_lps;
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
      if (nearest >= 0 && nearest <= std::pow((ring - 1) * kCell_mm, 2)) break;
      for (int di = -ring; di <= ring; ++di) {
        const int step = std::abs(di) == ring || ring == 0 ? 1 : 2 * ring;
        for (int dj = -ring; dj <= ring; dj += step) {
          const auto found = above->second.find({i + di, j + dj});
          if (found == above->second.end()) continue;
          for (const Sample& sample : found->second) {
            const double distance = std::pow(sample.u - p.x(), 2) + std::pow(sample.v - p.y(), 2);
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

json array_of(Arrays& arrays, const std::vector<float>& numbers) {
  return arrays.add(std::span<const float>(numbers));
}
json array_of(Arrays& arrays, const std::vector<std::uint32_t>& numbers) {
  return arrays.add(std::span<const std::uint32_t>(numbers));
}

json describe_surface(const Loaded& loaded, Arrays& arrays) {
  if (loaded.surfaces.empty()) return nullptr;
  const auto T_plane_lps = plane_of_surface(loaded);
  if (!T_plane_lps) return nullptr;
  const Sheet& top = *loaded.sheets.front();
  const NearestHu field(loaded.all, loaded.asset.lattice, *T_plane_lps);
  std::vector<float> vertices, hu;
  std::vector<std::uint32_t> triangles;
  for (const AssetSurface& one : loaded.surfaces) {
    const auto first = static_cast<std::uint32_t>(vertices.size() / 3);
    const double step_mm = one.surface.lattice.step_mm();
    for (const SpacePoint& p : one.surface.vertices) {
      const Eigen::Vector3d at = *T_plane_lps * (Eigen::Vector3d(p[0], p[1], p[2]) * step_mm);
      const Eigen::Vector2d xy =
          top.transform.to_scene(at.head<2>() / top.transform.lattice.step_mm());
      for (const double x : {xy.x(), xy.y(), top.z_m + at.z() * 1e-3})
        vertices.push_back(static_cast<float>(x));
      if (!field.is_empty()) hu.push_back(field.at(at));
    }
    for (const auto& triangle : one.surface.triangles) {
      for (const std::uint32_t v : triangle)
        triangles.push_back(first + v);
    }
  }
  return {{"vertices", array_of(arrays, vertices)},
          {"triangles", array_of(arrays, triangles)},
          {"hu", field.is_empty() ? json() : array_of(arrays, hu)}};
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
          {"vertices", array_of(arrays, vertices)},
          {"triangles", array_of(arrays, triangles)},
          {"hu", has_hu ? array_of(arrays, slice.hu) : json()}};
}

json describe_tool(const SceneTool& scene_tool) {
  const Tool tool = make_tool(scene_tool);
  // The axes of the cross-section are those of the plate, tilted with the tool.
  const Eigen::Quaterniond tilt =
      Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), tool.axis_plate);
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

/// Returns the goals as they are written in the scene; null if it has none.
json goals_of(const std::filesystem::path& scene_file) {
  const auto bytes = read_file(scene_file, std::uint64_t{4} << 20);
  if (!bytes) return nullptr;
  const json scene = json::parse(bytes->begin(), bytes->end(), nullptr, false);
  return scene.is_object() && scene.contains("goals") ? scene["goals"] : json();
}

}  // namespace

Result<std::string> bone_of(const std::filesystem::path& scene_file,
                            const std::filesystem::path& asset) {
  const Result<Loaded> loaded = load(scene_file, asset);
  if (!loaded) return loaded.error();
  Arrays arrays;
  json slices = json::array();
  for (const auto& sheet : loaded->sheets)
    slices.push_back(describe_sheet(*sheet, loaded->asset, arrays));
  const json head = {{"schema", "trocar.bone/1"},
                     {"surface", describe_surface(*loaded, arrays)},
                     {"slices", std::move(slices)},
                     {"tool", describe_tool(loaded->scene.tool)},
                     {"force_scale", loaded->scene.force_law.force_scale},
                     {"goals", goals_of(scene_file)}};
  return arrays.with_json(json_text(head));
}

}  // namespace trocar::runtime
