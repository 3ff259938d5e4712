// SPDX-License-Identifier: Apache-2.0
#include "runtime/contact/sheet.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include "formats/geometry/lattice_offset.h"
#include "formats/geometry/mesh_validity.h"
#include "runtime/contact/tissue_choice.h"

namespace trocar::runtime {
namespace {

constexpr double kHeightRounding_m = 1e-12;  // rounding error of a difference of heights
constexpr double kMaxHeight_m = 1;           // largest distance of a slice from {B}'s origin

/// Centroid of the material in mm.
std::array<double, 2> centroid_mm(const SliceMesh& mesh, const Lattice& lattice) {
  const LatticePoint origin = mesh.vertices.front();
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double area = 0;
  for (const Triangle& t : mesh.triangles) {
    const Eigen::Vector2d a = offset_in_steps(mesh.vertices[t[0]], origin);
    const Eigen::Vector2d b = offset_in_steps(mesh.vertices[t[1]], origin);
    const Eigen::Vector2d c = offset_in_steps(mesh.vertices[t[2]], origin);
    const double doubled = (b - a).x() * (c - a).y() - (b - a).y() * (c - a).x();
    sum += doubled * (a + b + c) / 3;
    area += doubled;
  }
  sum /= area;
  return {(origin.x + sum.x()) * lattice.step_mm(), (origin.y + sum.y()) * lattice.step_mm()};
}

const AssetSlice* find_slice(const Asset& asset, int index) {
  const auto found = std::find_if(asset.slices.begin(), asset.slices.end(),
                                  [&](const AssetSlice& slice) { return slice.index == index; });
  return found == asset.slices.end() ? nullptr : &*found;
}

}  // namespace

void Sheet::index_mesh() {
  grid = TriangleGrid(mesh);
  boundary_grid = TriangleGrid(mesh, GridTriangles::kBoundary);
}

Result<void> place_body(Scene& scene, const Asset& asset, const std::string& name) {
  if (!scene.body) return {};
  const SceneBody& body = *scene.body;
  std::vector<const AssetSlice*> slices;
  for (const AssetSlice& slice : asset.slices) {
    if (slice.index >= body.from && slice.index <= body.to && !slice.mesh.triangles.empty())
      slices.push_back(&slice);
  }
  const std::string where =
      name + ": body of slices " + std::to_string(body.from) + " to " + std::to_string(body.to);
  if (slices.size() < 2) return refused(where + ": fewer than two of them have material");
  std::sort(slices.begin(), slices.end(),
            [](const AssetSlice* a, const AssetSlice* b) { return a->z_mm > b->z_mm; });
  scene.slices.clear();
  for (std::size_t i = 0; i < slices.size(); ++i) {
    const double below_m = (slices.front()->z_mm - slices[i]->z_mm) * 1e-3;
    if (i > 0) {
      const std::string pair = ": slices " + std::to_string(slices[i - 1]->index) + " and " +
                               std::to_string(slices[i]->index);
      const double gap_m = (slices[i - 1]->z_mm - slices[i]->z_mm) * 1e-3;
      if (!(gap_m >= kMinSliceGap_m - kHeightRounding_m))
        return refused(where + pair + " are less than 0.1 mm apart");
      const Eigen::Matrix3d a = slices[i - 1]->T_lps_plane.linear(),
                            b = slices[i]->T_lps_plane.linear();
      if (!(std::abs(a.col(2).normalized().dot(b.col(2).normalized())) > 1 - 1e-6))
        return refused(where + pair + " are not parallel");
    }
    if (!(body.top_z_m - below_m >= -kMaxHeight_m))
      return refused(where + ": reaches below -1 m; give a higher top_z_m or fewer slices");
    SceneSlice slice;
    slice.index = slices[i]->index;
    slice.z_m = body.top_z_m - below_m;
    scene.slices.push_back(slice);
  }
  return {};
}

Result<std::vector<std::unique_ptr<const Sheet>>> place_slices(const Scene& scene,
                                                               const Asset& asset,
                                                               const std::string& name) {
  std::vector<const AssetSlice*> slices;
  for (const SceneSlice& wanted : scene.slices) {
    const std::string where = name + ": slice " + std::to_string(wanted.index);
    const AssetSlice* slice = find_slice(asset, wanted.index);
    if (slice == nullptr) {
      return refused(where + ": the asset has no such slice" +
                     (asset.slices.empty()
                          ? std::string(" (it has none)")
                          : " (it has " + std::to_string(asset.slices.front().index) + " to " +
                                std::to_string(asset.slices.back().index) + ")"));
    }
    if (slice->mesh.triangles.empty()) return refused(where + ": has no material");
    if (const Result<void> valid = check_mesh(slice->mesh); !valid) {
      return refused(where + ": " + valid.error().message);
    }
    slices.push_back(slice);
  }

  PlanarTransform transform;
  transform.lattice = asset.lattice;
  transform.at_m = Eigen::Vector2d(scene.placement.at_m.data());
  const std::array<double, 2> anchor_mm = scene.placement.anchor_mm
                                              ? *scene.placement.anchor_mm
                                              : centroid_mm(slices.front()->mesh, asset.lattice);
  transform.anchor_mm = Eigen::Vector2d(anchor_mm.data());
  const double rotation_rad = scene.placement.rotation_deg * std::numbers::pi / 180;
  transform.cosine = std::cos(rotation_rad);
  transform.sine = std::sin(rotation_rad);

  // The tool's outlines must be simple polygons even after rounding to the lattice.
  const Tool tool = make_tool(scene.tool);
  if (smallest_clearance_m(tool) < kMinClearance * asset.lattice.step_m()) {
    return refused(name + ": the scene's tool has corners too close for the asset's lattice of " +
                   std::to_string(asset.lattice.step_mm()) + " mm");
  }
  if (tool.pieces == 0) {
    return refused(name + ": the scene's tool has more than " + std::to_string(kMaxToolPieces) +
                   " convex parts");
  }

  std::vector<std::unique_ptr<const Sheet>> sheets;
  for (std::size_t i = 0; i < slices.size(); ++i) {
    auto sheet = std::make_unique<Sheet>();
    sheet->slice_index = slices[i]->index;
    sheet->z_m = scene.slices[i].z_m;
    sheet->tissue = choose_tissue(scene, scene.slices[i], asset, *slices[i]).tissue;
    sheet->transform = transform;
    sheet->mesh = std::move(*make_sheet_mesh(slices[i]->mesh, kSpareVertices, kSpareTriangles));
    sheet->index_mesh();
    if (!slices[i]->hu.empty())
      sheet->hu = std::make_shared<const std::vector<float>>(slices[i]->hu);
    if (traits_of(scene.force_law.kind).uses_bone_volume) {
      sheet->field = std::make_shared<const SliceField>(
          slices[i]->mesh, slices[i]->hu, asset.lattice, asset.hu.find(slices[i]->index));
      sheet->edge = std::make_shared<const EdgeDistance>(slices[i]->pslg, asset.lattice);
    }
    sheets.push_back(std::move(sheet));
  }
  std::sort(sheets.begin(), sheets.end(),
            [](const auto& a, const auto& b) { return a->z_m > b->z_m; });
  return sheets;
}

Pose over_anchor(const Sheet& sheet, const Tool& tool) noexcept {
  Pose T_device_plate;
  T_device_plate.p_m << sheet.transform.at_m, sheet.z_m;
  T_device_plate.p_m -= tool.tip_plate_m;
  return T_device_plate;
}

}  // namespace trocar::runtime
