// SPDX-License-Identifier: Apache-2.0
// Synthetic slices and scenes for the tests of contact, control and sessions.
#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/session/scene.h"

namespace trocar::test {

/// A square of `cells` x `cells` squares of `cell` steps, lower left corner at `origin`, each cut
/// into two triangles along alternating diagonals.
inline SliceMesh square_mesh(LatticePoint origin, std::int32_t cell, int cells) {
  SliceMesh mesh;
  for (int j = 0; j <= cells; ++j) {
    for (int i = 0; i <= cells; ++i) {
      mesh.vertices.push_back({origin.x + i * cell, origin.y + j * cell});
    }
  }
  const auto at = [&](int i, int j) { return static_cast<std::uint32_t>(j * (cells + 1) + i); };
  for (int j = 0; j < cells; ++j) {
    for (int i = 0; i < cells; ++i) {
      const std::uint32_t a = at(i, j), b = at(i + 1, j), c = at(i + 1, j + 1), d = at(i, j + 1);
      if ((i + j) % 2 == 0) {
        mesh.triangles.push_back({a, b, c});
        mesh.triangles.push_back({a, c, d});
      } else {
        mesh.triangles.push_back({a, b, d});
        mesh.triangles.push_back({b, c, d});
      }
    }
  }
  return mesh;
}

/// `slices` slices of index 0, 1, ..., each the same mesh, lattice of 2^-8 mm.
inline Asset asset_of(const SliceMesh& mesh, int slices) {
  Asset asset;
  asset.generator = "test";
  for (int i = 0; i < slices; ++i) {
    AssetSlice slice;
    slice.index = i;
    slice.z_mm = i;
    slice.T_lps_plane.translation().z() = i;
    slice.mesh = mesh;
    slice.pslg = boundary_rings(mesh);
    asset.slices.push_back(slice);
  }
  return asset;
}

/// A square sheet of 40 mm around the plane's point (80, 60) mm, cells of 2 mm.
inline Asset square_asset(int slices) {
  return asset_of(square_mesh({60 * 256, 40 * 256}, 2 * 256, 20), slices);
}

/// The square asset's slice 0, 1, ... at the given heights, the hand going down along z at a
/// constant speed.
inline Scene descent_scene(const std::vector<double>& heights_m, double from_m, double to_m,
                           double speed_m_per_s) {
  Scene scene;
  scene.name = "descent";
  scene.placement.anchor_mm = {80, 60};
  for (std::size_t i = 0; i < heights_m.size(); ++i) {
    scene.slices.push_back({static_cast<int>(i), heights_m[i], {}});
  }
  const double descent_s = std::abs(from_m - to_m) / speed_m_per_s;
  scene.duration_s = descent_s + 0.3;
  scene.hand.trajectory = {
      {0, {0, 0, from_m}, {}}, {0.1, {0, 0, from_m}, {}}, {0.1 + descent_s, {0, 0, to_m}, {}}};
  return scene;
}

}  // namespace trocar::test
