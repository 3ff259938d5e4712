// SPDX-License-Identifier: Apache-2.0
// A scene's slices as sheets, each with its tissue (runtime/haptics/sheet.h, tissue_choice.h).
#include <gtest/gtest.h>

#include "runtime/haptics/sheet.h"
#include "runtime/haptics/slice_field.h"
#include "tests/support/sheet_fixture.h"

namespace trocar::runtime {
namespace {

TEST(PlaceSlices, RefusesWhatCannotBePlaced) {
  const Scene scene = test::descent_scene({0.12, 0.14}, 0.2, 0.1, 0.015);
  EXPECT_TRUE(place_slices(scene, test::square_asset(2), "a"));
  const auto absent = place_slices(scene, test::square_asset(1), "a.glb");
  ASSERT_FALSE(absent);
  EXPECT_NE(absent.error().message.find("a.glb: slice 1: the asset has no such slice"),
            std::string::npos);
  Asset empty = test::square_asset(2);
  empty.slices[1].mesh = {};
  EXPECT_FALSE(place_slices(scene, empty, "a"));
  Asset broken = test::square_asset(2);
  std::swap(broken.slices[0].mesh.triangles[7][0], broken.slices[0].mesh.triangles[7][1]);
  EXPECT_FALSE(place_slices(scene, broken, "a"));
  Scene fine_tool = scene;
  fine_tool.tool.outline_m = {{0, 0}, {0.003, 0}, {0.001, 5e-6}, {0, 0.003}};
  const auto fine = place_slices(fine_tool, test::square_asset(2), "a");
  ASSERT_FALSE(fine) << "5 um are less than one and a half steps of 3.9 um";
  EXPECT_NE(fine.error().message.find("corners too close"), std::string::npos);
  fine_tool.tool.outline_m[2][1] = 7e-6;
  EXPECT_TRUE(place_slices(fine_tool, test::square_asset(2), "a"));
  Scene intricate = scene;
  for (int k = 0; k < 10; ++k) {
    intricate.tool.outline_m.push_back({0.001 * k, -0.002});
    intricate.tool.outline_m.push_back({0.001 * k + 0.0005, 0});
  }
  intricate.tool.outline_m.push_back({0.02, 0.004});
  intricate.tool.outline_m.push_back({-0.002, 0.004});
  const auto comb = place_slices(intricate, test::square_asset(2), "a");
  ASSERT_FALSE(comb);
  EXPECT_NE(comb.error().message.find("convex parts"), std::string::npos);
}

TEST(PlaceSlices, SortsTheTopmostFirstAndPlacesTheCentroid) {
  Scene scene = test::descent_scene({0.12, 0.19, 0.14}, 0.2, 0.1, 0.015);
  scene.placement.anchor_mm.reset();
  const auto placed = place_slices(scene, test::square_asset(3), "a");
  ASSERT_TRUE(placed);
  EXPECT_EQ((*placed)[0]->z_m, 0.19);
  EXPECT_EQ((*placed)[0]->slice_index, 1);
  EXPECT_EQ((*placed)[2]->z_m, 0.12);
  EXPECT_LT(((*placed)[0]->transform.anchor_mm - Eigen::Vector2d(80, 60)).norm(), 1e-9);
}

TEST(TissueChoice, ByNameThenByLabelOrHuThenTheSceneDefault) {
  Scene scene;
  scene.tissue.threshold_N = 1;
  const auto add = [&](const char* name, double threshold_N) -> NamedTissue& {
    NamedTissue tissue;
    tissue.name = name;
    tissue.tissue.threshold_N = threshold_N;
    scene.tissues.push_back(tissue);
    return scene.tissues.back();
  };
  add("named", 2);
  add("label", 3).labels = {7, 22};
  add("range", 4).hu = {300, 500};
  Asset asset;
  AssetSlice slice;
  SceneSlice wanted;
  const auto threshold = [&] {
    return choose_tissue(scene, wanted, asset, slice).tissue.threshold_N;
  };
  EXPECT_EQ(threshold(), 1);
  slice.measures_json = R"({"mean_hu":500})";
  EXPECT_EQ(threshold(), 4);
  slice.measures_json = R"({"mean_hu":501})";
  EXPECT_EQ(threshold(), 1);
  asset.parameters_json = R"({"labels":[5,22]})";
  EXPECT_EQ(threshold(), 3);
  wanted.tissue = "named";
  EXPECT_EQ(threshold(), 2);
  wanted.tissue.reset();
  asset.parameters_json = R"({"labels":"22"})";  // not an array, as the pipeline writes
  slice.measures_json = R"({"mean_hu":"400"})";
  EXPECT_EQ(threshold(), 1);
}

}  // namespace
}  // namespace trocar::runtime
