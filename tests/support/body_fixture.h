// SPDX-License-Identifier: Apache-2.0
// Scenes, sheets and bone volumes for tests of the force law `cutting`.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "runtime/haptics/bone/bone_volume.h"
#include "runtime/haptics/sheet.h"
#include "tests/support/sheet_fixture.h"

namespace trocar::test {

// The hexagon of the default tool, radius R = 3 mm: 3 sqrt(3) / 2 R^2 and 6 R, and the diameter of
// the disc of that area.
inline constexpr double kHexagon_m2 = 2.598076211353316 * 9e-6;
inline constexpr double kHexagonOutline_m = 0.018;
inline constexpr double kHexagonWidth_m = 5.4563504609561855e-3;

/// Heights of `count` slices, the topmost first.
inline std::vector<double> stack(double top_m, double spacing_m, int count) {
  std::vector<double> heights_m;
  heights_m.reserve(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i)
    heights_m.push_back(top_m - i * spacing_m);
  return heights_m;
}

inline Scene cutting_scene(const std::vector<double>& heights_m) {
  Scene scene = descent_scene(heights_m, 0.13, 0.1, 0.015);
  scene.force_law.kind = ForceLawKind::kCutting;
  return scene;
}

/// A scene whose body is the asset's slices from one index to another, the highest at `top_m`.
inline Scene body_scene(int from, int to, double top_m) {
  Scene scene = cutting_scene({});
  scene.body = SceneBody{.from = from, .to = to, .top_z_m = top_m};
  return scene;
}

/// Square slices (square_asset) at this spacing, index 0 lowest; `hu` at every vertex if given.
inline Asset spaced_asset(int slices, double spacing_mm, const std::vector<double>& hu = {}) {
  Asset asset = square_asset(slices);
  for (int i = 0; i < slices; ++i) {
    AssetSlice& slice = asset.slices[static_cast<std::size_t>(i)];
    slice.z_mm = spacing_mm * i;
    slice.T_lps_plane.translation().z() = slice.z_mm;
    if (!hu.empty())
      slice.hu.assign(slice.mesh.vertices.size(),
                      static_cast<float>(hu[static_cast<std::size_t>(i)]));
  }
  return asset;
}

/// The sheets of a scene, kept.
struct Placed {
  std::vector<std::unique_ptr<const runtime::Sheet>> owned;
  std::vector<const runtime::Sheet*> sheets;

  Placed(Scene& scene, const Asset& asset) {
    const Result<void> ok = runtime::place_body(scene, asset, "a");
    EXPECT_TRUE(ok) << ok.error().message;
    auto placed = runtime::place_slices(scene, asset, "a");
    EXPECT_TRUE(placed) << placed.error().message;
    owned = std::move(*placed);
    for (const auto& sheet : owned)
      sheets.push_back(sheet.get());
  }
};

inline runtime::BoneVolume bone_volume_of(Scene scene, const Asset& asset) {
  const Placed placed(scene, asset);
  auto body = runtime::make_bone_volume(scene, placed.sheets);
  EXPECT_TRUE(body) << body.error().message;
  return std::move(*body);
}

/// Why there is no body; empty: there is.
inline std::string refusal_of(Scene scene, const Asset& asset) {
  const Placed placed(scene, asset);
  const auto body = runtime::make_bone_volume(scene, placed.sheets);
  return body ? std::string() : body.error().message;
}

}  // namespace trocar::test
