// SPDX-License-Identifier: Apache-2.0
#include "formats/asset/one_sheet.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "formats/base/json_text.h"
#include "formats/geometry/mesh_validity.h"
#include "formats/geometry/shared_borders.h"
#include "formats/geometry/weld_regions.h"

namespace trocar {
namespace {

std::vector<float> mean_of_welded(std::span<const AssetSlice> materials,
                                  const WeldedRegions& welded) {
  std::vector<double> sum(welded.mesh.vertices.size());
  std::vector<int> count(sum.size());
  for (std::size_t k = 0; k < materials.size(); ++k) {
    if (materials[k].hu.size() != materials[k].mesh.vertices.size()) return {};
    for (std::size_t v = 0; v < materials[k].hu.size(); ++v) {
      sum[welded.vertex[k][v]] += static_cast<double>(materials[k].hu[v]);
      ++count[welded.vertex[k][v]];
    }
  }
  std::vector<float> out;
  for (std::size_t v = 0; v < sum.size(); ++v)
    out.push_back(static_cast<float>(sum[v] / count[v]));
  return out;
}

std::optional<double> mean_by_area(std::span<const AssetSlice> materials) {
  double sum = 0, area = 0;
  for (const AssetSlice& one : materials) {
    const std::optional<double> mean = mean_hu_of(one);
    if (!mean) return std::nullopt;
    const auto weight = static_cast<double>(doubled_area(one.mesh));
    sum += weight * *mean;
    area += weight;
  }
  return area > 0 ? std::optional(sum / area) : std::nullopt;
}

Result<AssetSlice> welded(std::span<const AssetSlice> materials) {
  std::vector<Pslg> outlines;
  std::vector<const SliceMesh*> meshes;
  for (const AssetSlice& one : materials) {
    if (one.T_lps_plane.matrix() != materials[0].T_lps_plane.matrix() ||
        one.z_mm != materials[0].z_mm)
      return refused("its materials lie in different planes");
    if (auto ok = check_mesh_against_pslg(one.mesh, one.pslg); !ok) return ok.error();
    outlines.push_back(one.pslg);
    meshes.push_back(&one.mesh);
  }
  auto outline = check_shared_borders(outlines, outlines);
  if (!outline) return refused("its materials: " + outline.error().message);
  auto made = weld_regions(meshes);
  if (!made) return made.error();
  AssetSlice out;
  out.index = materials[0].index;
  out.z_mm = materials[0].z_mm;
  out.T_lps_plane = materials[0].T_lps_plane;
  out.pslg = std::move(*outline);
  out.hu = mean_of_welded(materials, *made);
  if (const auto mean = mean_by_area(materials); mean)
    out.measures_json = json_text(nlohmann::json{{"mean_hu", *mean}});
  out.mesh = std::move(made->mesh);
  return out;
}

// HU of a triangle: the mean at its centroid and half-way from there to its corners. NaN if unknown.
double mean_in(const HuPlane& plane, const Lattice& lattice,
               const std::array<LatticePoint, 3>& corners) {
  Eigen::Vector2d centroid = Eigen::Vector2d::Zero();
  for (const LatticePoint p : corners)
    centroid += Eigen::Vector2d(lattice.to_mm(p.x), lattice.to_mm(p.y)) / 3;
  auto sum = static_cast<double>(plane.at(centroid.x(), centroid.y()));
  for (const LatticePoint p : corners) {
    const Eigen::Vector2d at =
        (centroid + Eigen::Vector2d(lattice.to_mm(p.x), lattice.to_mm(p.y))) / 2;
    sum += static_cast<double>(plane.at(at.x(), at.y()));
  }
  return sum / 4;
}

std::vector<float> hu_at_vertices(const SliceMesh& mesh, const HuPlane& plane,
                                  const Lattice& lattice) {
  std::vector<double> sum(mesh.vertices.size(), 0), area(mesh.vertices.size(), 0);
  for (const Triangle& t : mesh.triangles) {
    const std::array<LatticePoint, 3> corners{mesh.vertices[t[0]], mesh.vertices[t[1]],
                                              mesh.vertices[t[2]]};
    const double hu = mean_in(plane, lattice, corners);
    const auto weight = static_cast<double>(orient2d(corners[0], corners[1], corners[2]));
    if (std::isnan(hu)) continue;
    for (const std::uint32_t v : t) {
      sum[v] += weight * hu;
      area[v] += weight;
    }
  }
  std::vector<float> out;
  for (std::size_t v = 0; v < sum.size(); ++v)
    out.push_back(area[v] > 0 ? static_cast<float>(sum[v] / area[v]) : 0.0F);
  return out;
}

}  // namespace

void add_hu_at_vertices(Asset& asset) {
  for (AssetSlice& slice : asset.slices) {
    const HuPlane* const plane = asset.hu.find(slice.index);
    if (plane != nullptr && slice.hu.empty())
      slice.hu = hu_at_vertices(slice.mesh, *plane, asset.lattice);
  }
}

Result<void> weld_materials(Asset& asset, const std::string& name) {
  if (slice_count(asset) == asset.slices.size()) return {};
  // All slices are joined before the asset is changed, because a later one may be refused.
  std::vector<AssetSlice> slices;
  std::vector<std::size_t> unchanged;
  for (std::size_t i = 0; i < asset.slices.size();) {
    const std::span<const AssetSlice> materials = materials_of_slice(asset, i);
    if (materials.size() == 1) {
      unchanged.push_back(i);
    } else {
      auto one = welded(materials);
      if (!one)
        return refused(name + ": slice " + std::to_string(asset.slices[i].index) + ": " +
                       one.error().message);
      slices.push_back(std::move(*one));
    }
    i += materials.size();
  }
  for (const std::size_t i : unchanged)
    slices.push_back(std::move(asset.slices[i]));
  std::sort(slices.begin(), slices.end(),
            [](const AssetSlice& a, const AssetSlice& b) { return a.index < b.index; });
  for (AssetSlice& slice : slices)
    slice.material = 0;
  asset.slices = std::move(slices);
  asset.materials = {{"material", {}}};
  return {};
}

}  // namespace trocar
