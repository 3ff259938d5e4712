// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/asset_description.h"

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "formats/base/json_text.h"

namespace trocar::pipeline {
namespace {

using nlohmann::json;
/// Bounding box of the mesh in the slice plane, mm; it is empty for an empty mesh.
Eigen::AlignedBox2d box_of(const SliceMesh& mesh, double step_mm) {
  Eigen::AlignedBox2d box;
  for (const LatticePoint p : mesh.vertices)
    box.extend(Eigen::Vector2d(p.x * step_mm, p.y * step_mm));
  return box;
}

/// The lowest and the highest corner of a box; null for an empty box.
json corners_json(const Eigen::AlignedBox2d& box) {
  if (box.isEmpty()) return nullptr;
  return {{box.min().x(), box.min().y()}, {box.max().x(), box.max().y()}};
}

/// Centroid of the material in the slice plane, mm; std::nullopt for an empty mesh.
std::optional<std::array<double, 2>> centroid_of(const SliceMesh& mesh, double step_mm) {
  double area = 0;
  std::array<double, 2> sum{};
  for (const Triangle& triangle : mesh.triangles) {
    std::array<std::array<double, 2>, 3> p;
    for (std::size_t k = 0; k < 3; ++k) {
      const LatticePoint corner = mesh.vertices[triangle[k]];
      p[k] = {static_cast<double>(corner.x), static_cast<double>(corner.y)};
    }
    const double each =
        (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[1][1] - p[0][1]) * (p[2][0] - p[0][0]);
    area += each;
    for (std::size_t k = 0; k < 2; ++k)
      sum[k] += each * (p[0][k] + p[1][k] + p[2][k]) / 3;
  }
  if (!(area > 0)) return std::nullopt;
  return std::array<double, 2>{sum[0] / area * step_mm, sum[1] / area * step_mm};
}

template <typename T>
json or_null(const std::optional<T>& value) {
  return value ? json(*value) : json(nullptr);
}

}  // namespace

json describe_asset(const Asset& asset, std::uint64_t bytes) {
  json slices = json::array();
  Eigen::AlignedBox2d all;
  std::size_t triangles = 0;
  const double step2 = asset.lattice.step_mm() * asset.lattice.step_mm();
  std::vector<double> areas_mm2(asset.materials.size());
  for (const AssetSlice& s : asset.slices) {
    const double area_mm2 = 0.5 * static_cast<double>(doubled_area(s.mesh)) * step2;
    areas_mm2[static_cast<std::size_t>(s.material)] += area_mm2;
    std::size_t outline = 0;
    for (const Ring& ring : s.pslg.rings)
      outline += ring.size();
    triangles += s.mesh.triangles.size();
    const Eigen::AlignedBox2d box = box_of(s.mesh, asset.lattice.step_mm());
    all.extend(box);
    slices.push_back(
        {{"index", s.index},
         {"material", s.material},
         {"z_mm", s.z_mm},
         {"vertices", s.mesh.vertices.size()},
         {"triangles", s.mesh.triangles.size()},
         {"rings", s.pslg.rings.size()},
         {"outline_segments", outline},
         {"area_mm2", area_mm2},
         {"box_mm", corners_json(box)},
         {"centroid_mm", or_null(centroid_of(s.mesh, asset.lattice.step_mm()))},
         {"mean_hu", s.mesh.triangles.empty() ? json(nullptr) : or_null(mean_hu_of(s))},
         {"measures", parse_known_json(s.measures_json)}});
  }
  json surfaces = json::array();
  for (const AssetSurface& one : asset.surfaces) {
    const Lattice& lattice = one.surface.lattice;
    surfaces.push_back(
        {{"material", one.material},
         {"triangles", one.surface.triangles.size()},
         {"vertices", one.surface.vertices.size()},
         {"lattice_step_mm", lattice.step_mm()},
         {"distance_p99_mm", one.distance_mm},
         {"volume_mm3", enclosed_volume(one.surface) * std::pow(lattice.step_mm(), 3)}});
  }
  json materials = json::array();
  for (std::size_t m = 0; m < asset.materials.size(); ++m) {
    const AssetMaterial& material = asset.materials[m];
    materials.push_back({{"name", material.name},
                         {"label", material.label ? json(*material.label) : json()},
                         {"area_mm2", areas_mm2[m]}});
  }
  json out = {{"generator", asset.generator},
              {"schema", kAssetSchema},
              {"lattice_bits", asset.lattice.bits},
              {"lattice_step_mm", asset.lattice.step_mm()},
              {"materials", std::move(materials)},
              {"parameters", parse_known_json(asset.parameters_json)},
              {"bytes", bytes},
              {"triangles", triangles},
              {"box_mm", corners_json(all)},
              {"surfaces", std::move(surfaces)},
              {"slices", std::move(slices)}};
  for (const HuVolume* volume : {&asset.hu, &asset.context}) {
    if (volume->planes.empty()) continue;
    out["hu_volumes"].push_back(
        {{"covers", volume->grid.covers_everything() ? "everything" : "material"},
         {"planes", volume->planes.size()},
         {"pitch_mm", {volume->grid.pitch_mm.x(), volume->grid.pitch_mm.y()}},
         {"step_hu", volume->grid.step_hu}});
    if (!volume->grid.covers_everything())
      out["hu_volumes"].back()["margin_mm"] = asset.lattice.to_mm(volume->grid.margin_steps);
  }
  if (!asset.input_key_digest.empty()) out["input_key_digest"] = asset.input_key_digest;
  return out;
}

}  // namespace trocar::pipeline
