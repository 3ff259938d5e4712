// SPDX-License-Identifier: GPL-3.0-or-later
// Scans with small pixels: defaults follow the pixel, and what is dropped, filled or moved is
// counted. A grid of walls, as in trabecular bone, is the same in pixels at every scale.
#include "pipeline/bake/report.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "tests/support/memory_stack.h"
#include "tests/support/take.h"

namespace trocar::pipeline {
namespace {

using nlohmann::json;

constexpr int kPixels = 85, kPlanes = 2;

// Slices in HU, all the same.
MemoryStack equal_slices(double pixel_mm, int side, int slices,
                         const std::function<double(int x, int y)>& value) {
  MemoryStack out;
  out.images.assign(static_cast<std::size_t>(slices), image_of(side, side, value));
  for (int k = 0; k < slices; ++k)
    out.planes.push_back(axial_plane(pixel_mm, k * pixel_mm));
  return out;
}

// Walls of 5 pixels around 16 cells of 15 x 15.
MemoryStack grid_of_walls(double pixel_mm) {
  return equal_slices(pixel_mm, kPixels, kPlanes,
                      [](int x, int y) { return x % 20 < 5 || y % 20 < 5 ? 1500.0 : -20.0; });
}

StackOptions defaults() {
  StackOptions out;
  out.mesh.segmentation = Threshold{226};
  out.defaults = {true, true, true, false, false};
  out.threads = 1;
  return out;
}

json report_of(const SliceStack& stack, StackOptions options) {
  follow_small_pixels(stack, options);
  return test::take(mesh_stack(stack, options, json::object())).report;
}

double area_px(const json& report, double pixel_mm) {
  return report["changes"]["area_mm2"].get<double>() / (pixel_mm * pixel_mm) / kPlanes;
}

std::set<std::string> codes(const json& report) {
  std::set<std::string> out;
  for (const json& warning : report["warnings"])
    out.insert(warning["code"]);
  return out;
}

TEST(SmallPixels, AGridOfWallsHasTheSameAreaInPixelsAtEveryScale) {
  StackOptions exact;
  exact.mesh.segmentation = Threshold{226};
  exact.mesh.min_region_mm2 = 0;
  exact.mesh.simplification.tolerance_mm = 0;
  const double right = area_px(report_of(grid_of_walls(1), exact), 1);
  for (const double pixel_mm : {0.01, 0.02, 0.05, 0.1, 0.2, 0.25, 0.29}) {
    const json report = report_of(grid_of_walls(pixel_mm), defaults());
    EXPECT_NEAR(area_px(report, pixel_mm), right, 0.005 * right) << pixel_mm;
    EXPECT_EQ(report["changes"]["dropped_mm2"], 0) << pixel_mm;
    EXPECT_EQ(report["changes"]["filled_mm2"], 0) << pixel_mm;
    EXPECT_EQ(report["changes"]["moved_mm2"], 0) << pixel_mm;
    EXPECT_TRUE(report["warnings"].empty()) << pixel_mm << ": " << report["warnings"];
  }
}

// A change of these would change the bytes of ordinary assets.
TEST(SmallPixels, OrdinaryPixelsKeepTheDefaults) {
  for (const double pixel_mm : {0.29995, 0.3, 0.7, 1.5}) {
    StackOptions options = defaults();
    options.defaults.close = options.defaults.min_volume = true;
    options.solid.close_mm = 3;
    options.solid.min_volume_mm3 = 100;
    follow_small_pixels(grid_of_walls(pixel_mm), options);
    EXPECT_EQ(options.mesh.simplification.tolerance_mm, 0.2);
    EXPECT_EQ(options.mesh.min_region_mm2, 1);
    EXPECT_EQ(options.mesh.lattice.bits, 8);
    EXPECT_EQ(options.solid.close_mm, 3);
    EXPECT_EQ(options.solid.min_volume_mm3, 100);
  }
}

TEST(SmallPixels, GivenValuesStay) {
  StackOptions options = defaults();
  options.defaults = {};
  options.solid.close_mm = 3;
  options.solid.min_volume_mm3 = 100;
  follow_small_pixels(grid_of_walls(0.05), options);
  EXPECT_EQ(options.mesh.simplification.tolerance_mm, 0.2);
  EXPECT_EQ(options.mesh.min_region_mm2, 1);
  EXPECT_EQ(options.mesh.lattice.bits, 8);
  EXPECT_EQ(options.solid.close_mm, 3);
  EXPECT_EQ(options.solid.min_volume_mm3, 100);
  options.defaults.close = options.defaults.min_volume = true;
  follow_small_pixels(grid_of_walls(0.03), options);
  EXPECT_NEAR(options.solid.close_mm, 0.3, 1e-12);
  EXPECT_NEAR(options.solid.min_volume_mm3, 0.1, 1e-12);
}

// An asset holds 2^23 lattice steps.
TEST(SmallPixels, TheLatticeIsNoFinerThanAnAssetHolds) {
  const MemoryStack stack = equal_slices(0.01, 2, 1, [](int, int) { return 1500.0; });
  StackOptions options = defaults();
  follow_small_pixels(stack, options);
  EXPECT_EQ(options.mesh.lattice.bits, 13);
  MemoryStack wide;
  wide.images.push_back({100, 100, std::vector<float>(10'000)});
  wide.planes.push_back({0.01, 20, Eigen::Affine3d::Identity(), 0});
  options = defaults();
  follow_small_pixels(wide, options);
  EXPECT_EQ(options.mesh.lattice.bits, 12);
}

TEST(SmallPixels, WhatAGivenRegionFillsIsCountedAndNamed) {
  StackOptions options = defaults();
  options.defaults.min_region = false;
  options.mesh.simplification.tolerance_mm = 0;
  options.defaults.tolerance = false;
  const json report = report_of(grid_of_walls(0.05), options);
  options.mesh.min_region_mm2 = 0;
  const json whole = report_of(grid_of_walls(0.05), options);
  const json &changes = report["changes"], &first = report["slices"][0];
  EXPECT_GT(changes["filled_mm2"].get<double>(), 0.46 * changes["area_mm2"].get<double>());
  EXPECT_NEAR(changes["area_mm2"].get<double>() - changes["filled_mm2"].get<double>(),
              whole["changes"]["area_mm2"].get<double>(), 1e-9);
  EXPECT_NEAR(first["filled_mm2"].get<double>(), changes["filled_mm2"].get<double>() / kPlanes,
              1e-9);
  EXPECT_EQ(codes(report), std::set<std::string>{"holes_filled"});
  EXPECT_EQ(report["warnings"][0]["slices"], json({0, 1}));
  EXPECT_TRUE(codes(whole).empty());
}

TEST(SmallPixels, DroppedIslandsAreCountedAndNamed) {
  // A large square and nine small ones.
  const MemoryStack stack = equal_slices(0.5, 60, 1, [](int x, int y) {
    const bool is_small = y >= 50 && y < 52 && x % 6 < 2 && x < 54;
    return (x >= 10 && x < 30 && y >= 10 && y < 30) || is_small ? 1000.0 : -20.0;
  });
  StackOptions options = defaults();
  options.mesh.min_region_mm2 = 2;
  const json report = report_of(stack, options);
  EXPECT_GT(report["changes"]["dropped_mm2"].get<double>(), 9.0);
  EXPECT_EQ(codes(report), std::set<std::string>{"regions_dropped"});
  EXPECT_NE(report["warnings"][0]["sentence"].get<std::string>().find("--min-region 2 mm^2"),
            std::string::npos);
}

TEST(SmallPixels, WhatAGivenToleranceMovesIsCountedAndNamed) {
  const MemoryStack disc = equal_slices(
      0.05, 60, 1, [](int x, int y) { return std::hypot(x - 30, y - 30) < 20 ? 1000.0 : -20.0; });
  StackOptions options = defaults();
  options.defaults.tolerance = false;
  const json report = report_of(disc, options);
  EXPECT_GT(report["changes"]["moved_mm2"].get<double>(), 0);
  EXPECT_EQ(codes(report), std::set<std::string>{"outline_moved"}) << report["changes"];
  EXPECT_EQ(report_of(disc, defaults())["changes"]["moved_mm2"], 0);
}

// A map of 0 and 1 loses its small components as pixels.
TEST(SmallPixels, ChangesOfALabelMapAreThoseOfItsPixels) {
  const MemoryStack stack = equal_slices(0.5, 40, 1, [](int x, int y) {
    const bool is_square = x >= 5 && x < 25 && y >= 5 && y < 25;
    const bool is_hole = x >= 10 && x < 11 && y >= 10 && y < 12;
    const bool is_speck = x >= 30 && x < 33 && y == 30;
    return (is_square && !is_hole) || is_speck ? 1.0 : 0.0;
  });
  StackOptions options = defaults();
  options.mesh.segmentation = Labels{{1}, false};
  const json report = report_of(stack, options);
  EXPECT_NEAR(report["changes"]["filled_mm2"].get<double>(), 2 * 0.25, 1e-12);
  EXPECT_NEAR(report["changes"]["dropped_mm2"].get<double>(), 3 * 0.25, 1e-12);
}

// Two specks in opposite corners: their HU lie in a box of the whole image, with more samples than
// a reader admits for so small a file.
TEST(SparseScan, ItsHuAreCoarserSoThatItsReaderAcceptsThem) {
  const MemoryStack stack = equal_slices(0.7, 2500, 3, [](int x, int y) {
    return (x < 4 && y < 4) || (x >= 2495 && y >= 2495) ? 1000.0 : -20.0;
  });
  StackOptions options = defaults();
  const auto made = test::take(mesh_stack(stack, options, json::object()));
  const auto asset = test::take(decode_asset(made.glb, "sparse.glb"));
  EXPECT_EQ(codes(made.report), std::set<std::string>{"hu_coarser"});
  ASSERT_EQ(asset.hu.planes.size(), 3U);
  EXPECT_NEAR(asset.hu.grid.pitch_mm.x(), 1.4, 1e-9);
  EXPECT_GT(asset.hu.planes[0].at(0.7, 0.7), 700);
}

}  // namespace
}  // namespace trocar::pipeline
