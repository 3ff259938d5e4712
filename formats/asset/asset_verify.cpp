// SPDX-License-Identifier: Apache-2.0
#include <utility>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/geometry/mesh_validity.h"
#include "formats/geometry/shared_borders.h"

namespace trocar {
namespace {

// The materials of one slice must lie in one plane and must not overlap.
Result<void> verify_together(std::span<const AssetSlice> materials) {
  std::vector<Pslg> outlines;
  for (const AssetSlice& one : materials) {
    if (one.z_mm != materials[0].z_mm ||
        one.T_lps_plane.matrix() != materials[0].T_lps_plane.matrix())
      return refused("its materials lie in different planes");
    outlines.push_back(one.pslg);
  }
  if (auto ok = check_shared_borders(outlines, outlines); !ok)
    return refused("its materials: " + ok.error().message);
  return {};
}

}  // namespace

std::span<const AssetSlice> materials_of_slice(const Asset& asset, std::size_t first) {
  std::size_t end = first + 1;
  while (end < asset.slices.size() && asset.slices[end].index == asset.slices[first].index)
    ++end;
  return std::span(asset.slices).subspan(first, end - first);
}

std::size_t slice_count(const Asset& asset) {
  std::size_t count = 0;
  for (std::size_t i = 0; i < asset.slices.size(); i += materials_of_slice(asset, i).size())
    ++count;
  return count;
}

Result<void> verify_asset(const Asset& asset, const std::string& name) {
  const auto wrong = [&name](const AssetSlice& slice, const std::string& why) {
    return refused(name + ": slice " + std::to_string(slice.index) + ": " + why);
  };
  for (const AssetSlice& slice : asset.slices) {
    if (slice.mesh.triangles.empty() && slice.pslg.rings.empty()) continue;
    if (auto ok = check_mesh_against_pslg(slice.mesh, slice.pslg); !ok)
      return wrong(slice, ok.error().message);
    if (!slice.hu.empty() && slice.hu.size() != slice.mesh.vertices.size())
      return wrong(slice, "not an HU for each vertex");
    const Eigen::Matrix3d L = slice.T_lps_plane.linear();
    if (!((L.transpose() * L - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() < 1e-4) ||
        L.determinant() < 0)
      return wrong(slice, "its plane's frame is not a rotation");
  }
  for (std::size_t i = 0; i < asset.slices.size(); i += materials_of_slice(asset, i).size()) {
    const auto materials = materials_of_slice(asset, i);
    if (materials.size() < 2) continue;
    if (auto ok = verify_together(materials); !ok) return wrong(materials[0], ok.error().message);
  }
  for (const AssetSurface& one : asset.surfaces) {
    if (auto ok = check_triangle_surface(one.surface); !ok)
      return refused(name + ": surface of material " + std::to_string(one.material) + ": " +
                     ok.error().message);
  }
  return {};
}

}  // namespace trocar
