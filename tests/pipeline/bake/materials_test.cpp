// SPDX-License-Identifier: GPL-3.0-or-later
// Several materials of a label map in one asset: read back from its bytes, their meshes leave no
// gap and do not overlap.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>
#include <string>
#include <utility>

#include "formats/asset/asset.h"
#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/shared_borders.h"
#include "pipeline/bake/mesh_stack.h"
#include "pipeline/surface/cgal_verification.h"
#include "tests/support/label_maps.h"
#include "tests/support/take.h"

namespace trocar::pipeline {
namespace {

Image each_pixel(Image image, const std::function<float(float)>& value) {
  std::transform(image.values.begin(), image.values.end(), image.values.begin(), value);
  return image;
}

// The map, nothing, and the map with its labels in reverse order.
constexpr int kReversed = 21;
MemoryStack three_slices(const Image& map) {
  return MemoryStack({map, each_pixel(map, [](float) { return 0.0F; }),
                      each_pixel(map, [](float v) { return v == 0 ? 0.0F : kReversed - v; })});
}

StackOptions all_labels(double min_region_mm2 = 1) {
  StackOptions options;
  options.mesh.segmentation = Labels{{}, true};
  options.mesh.min_region_mm2 = min_region_mm2;
  options.threads = 1;
  return options;
}

Asset asset_of(const Result<StackResult>& made) {
  return test::take(decode_asset(test::take(made).glb, "made.glb"));
}

TEST(Materials, TenMapsHaveNoGapAndNoOverlap) {
  for (const double min_region_mm2 : {0.0, 0.4}) {
    for (const auto& [name, map] : ten_label_maps()) {
      const MemoryStack stack = three_slices(map);
      const auto made = mesh_stack(stack, all_labels(min_region_mm2), {});
      const Asset asset = asset_of(made);
      ASSERT_FALSE(asset.slices.empty()) << name;
      const auto proved = verify_asset(asset, name);
      EXPECT_TRUE(proved) << proved.error().message;
      const auto confirmed = confirm_by_cgal(asset, name);
      EXPECT_TRUE(confirmed) << confirmed.error().message;

      std::set<int> labels;
      for (const float v : map.values) {
        if (v != 0)
          labels.merge(std::set<int>{static_cast<int>(v), kReversed - static_cast<int>(v)});
      }
      if (min_region_mm2 == 0) {
        ASSERT_EQ(asset.materials.size(), labels.size()) << name;
        auto label = labels.begin();
        for (const AssetMaterial& material : asset.materials) {
          EXPECT_EQ(material.label, *label) << name;
          EXPECT_EQ(material.name, "label " + std::to_string(*label++)) << name;
        }
      }
      EXPECT_EQ(labels_of(asset), std::vector<int>(labels.begin(), labels.end())) << name;

      std::size_t entries = 0, slices = 0;
      for (std::size_t i = 0; i < asset.slices.size(); ++slices) {
        const auto materials = materials_of_slice(asset, i);
        i += materials.size();
        const std::string what = name + ", slice " + std::to_string(materials[0].index);
        std::int64_t sum = 0;
        std::vector<Pslg> outlines;
        for (const AssetSlice& one : materials) {
          sum += doubled_area(one.mesh);
          outlines.push_back(one.pslg);
          entries += 1;
        }
        // Gap and overlap. The areas sum exactly.
        const auto outline = check_shared_borders(outlines, outlines);
        ASSERT_TRUE(outline) << what << ": " << outline.error().message;
        EXPECT_EQ(doubled_area(*outline), sum) << what;
        const double pixels = static_cast<double>(
            std::count_if(map.values.begin(), map.values.end(), [](float v) { return v != 0; }));
        const double mm2 = 0.5 * static_cast<double>(sum) / 65536;
        if (materials[0].index != 1 && name.find("salt") == std::string::npos) {
          EXPECT_NEAR(mm2 / (0.49 * pixels), 1, 0.03) << what;
        }
      }
      EXPECT_EQ(slices, 3U) << name;
      EXPECT_GE(entries, 3U) << name;
      ASSERT_TRUE(made);
      ASSERT_EQ(made->report["slices"].size(), entries) << name;
      for (std::size_t i = 0; i < entries; ++i) {
        const auto& said = made->report["slices"][i];
        EXPECT_EQ(said["index"], asset.slices[i].index);
        EXPECT_EQ(said["triangles"], asset.slices[i].mesh.triangles.size());
        EXPECT_LE(said["simplification_error_mm"], 0.2);
        if (said["triangles"] > 0) {
          EXPECT_EQ(said["material"],
                    asset.materials[static_cast<std::size_t>(asset.slices[i].material)].name);
        }
      }

      StackOptions two = all_labels(min_region_mm2);
      two.threads = 2;
      const auto again = mesh_stack(stack, two, {});
      EXPECT_TRUE(again && again->glb == made->glb) << name << ": 1 and 2 threads differ";

      Asset sheet = asset;
      test::take(weld_materials(sheet, name));
      ASSERT_EQ(sheet.slices.size(), 3U);
      for (std::size_t i = 0, k = 0; k < 3; ++k) {
        const auto materials = materials_of_slice(asset, i);
        i += materials.size();
        const AssetSlice& slice = sheet.slices[k];
        if (slice.mesh.triangles.empty()) continue;
        const auto ok = check_mesh_against_pslg(slice.mesh, slice.pslg);
        EXPECT_TRUE(ok) << name << ": " << ok.error().message;
        EXPECT_EQ(slice.pslg.rings, boundary_rings(slice.mesh).rings) << name;
        std::int64_t sum = 0;
        for (const AssetSlice& one : materials)
          sum += doubled_area(one.mesh);
        EXPECT_EQ(doubled_area(slice.mesh), sum) << name;
      }
    }
  }
}

// A material's triangles moved by a step into its neighbour, or onto its side of an edge.
TEST(Materials, APlantedOverlapIsRefused) {
  const Asset asset = asset_of(mesh_stack(three_slices(organs(96, 1)), all_labels(), {}));
  ASSERT_GT(materials_of_slice(asset, 0).size(), 5U);
  for (const LatticePoint by : {LatticePoint{1, 0}, LatticePoint{0, -1}, LatticePoint{500, 300}}) {
    Asset moved = asset;
    for (LatticePoint& p : moved.slices[2].mesh.vertices)
      p = {p.x + by.x, p.y + by.y};
    moved.slices[2].pslg = boundary_rings(moved.slices[2].mesh);
    const auto proved = verify_asset(moved, "moved.glb");
    EXPECT_TRUE(!proved && proved.error().message.find("its materials: ") != std::string::npos);
    const auto confirmed = confirm_by_cgal(moved, "moved.glb");
    EXPECT_FALSE(confirmed);
    const auto welded = weld_materials(moved, "moved.glb");
    EXPECT_FALSE(welded);
  }
  Asset twice = asset;
  twice.slices[1].mesh = twice.slices[0].mesh;
  twice.slices[1].pslg = twice.slices[0].pslg;
  EXPECT_FALSE(verify_asset(twice, "twice.glb"));
  EXPECT_FALSE(confirm_by_cgal(twice, "twice.glb"));
  EXPECT_FALSE(weld_materials(twice, "twice.glb"));
  // Refused only after a slice with one material: the asset keeps that slice, too.
  Asset late = asset;
  const auto several = static_cast<std::ptrdiff_t>(materials_of_slice(late, 0).size());
  late.slices.erase(late.slices.begin() + 1, late.slices.begin() + several);
  AssetSlice &last = late.slices.back(), &before = late.slices[late.slices.size() - 2];
  ASSERT_EQ(last.index, before.index);
  last.mesh = before.mesh;
  last.pslg = before.pslg;
  EXPECT_FALSE(weld_materials(late, "late.glb"));
  EXPECT_EQ(late.slices[0].mesh.vertices, asset.slices[0].mesh.vertices);
  // One within another, and in another plane.
  Asset within = asset;
  const SliceMesh& outer = asset.slices[0].mesh;
  const Triangle t = outer.triangles[0];
  const LatticePoint a = outer.vertices[t[0]], b = outer.vertices[t[1]], c = outer.vertices[t[2]];
  const LatticePoint middle{(a.x + b.x + c.x) / 3, (a.y + b.y + c.y) / 3};
  within.slices[1].mesh = {{middle, {middle.x + 4, middle.y}, {middle.x, middle.y + 4}},
                           {{0, 1, 2}}};
  within.slices[1].pslg = boundary_rings(within.slices[1].mesh);
  within.slices[1].hu.clear();
  within.slices.erase(within.slices.begin() + 2, within.slices.end());
  EXPECT_FALSE(verify_asset(within, "within.glb"));
  EXPECT_FALSE(confirm_by_cgal(within, "within.glb"));
  Asset damaged = asset;
  damaged.slices[1].mesh.triangles[0][1] = 0xffffff;
  EXPECT_FALSE(weld_materials(damaged, "damaged.glb"));
  Asset apart = asset;
  apart.slices[1].T_lps_plane.translation().z() += 0.5;
  EXPECT_FALSE(verify_asset(apart, "apart.glb"));
  EXPECT_FALSE(weld_materials(apart, "apart.glb"));
}

// Joined labels are one material with both names; what one label gives does not depend on how it
// was asked for.
TEST(Materials, AreJoinedAndNamed) {
  MemoryStack stack = three_slices(organs(96, 1));
  stack.label_names = {{1, "L1"}, {2, "L2"}, {3, "L3"}};
  StackOptions options = all_labels();
  options.mesh.segmentation = Labels{{1, 2, 3, 7}, false, {{2, 3}}};
  const Asset asset = asset_of(mesh_stack(stack, options, {}));
  ASSERT_EQ(asset.materials.size(), 3U);
  EXPECT_EQ(asset.materials[0].name, "L1");
  EXPECT_EQ(asset.materials[1].name, "L2 + L3");
  EXPECT_EQ(asset.materials[1].label, std::nullopt);
  EXPECT_EQ(asset.materials[2].name, "label 7");
  EXPECT_EQ(asset.materials[2].label, 7);

  std::set<int> ten;
  for (int label = 1; label <= kMapLabels; ++label)
    ten.insert(label);
  options.mesh.segmentation = Labels{ten, false, {ten}};
  const Asset joined = asset_of(mesh_stack(stack, options, {}));
  ASSERT_EQ(joined.materials.size(), 1U);
  EXPECT_LE(joined.materials[0].name.size(), kMaxNameBytes);
  EXPECT_EQ(joined.materials[0].name, "L1 + L2 + L3 + label 4 + label 5 + label 6 + 4 more");
  Image both = each_pixel(organs(96, 1), [](float v) { return v == 0 ? 0.0F : 1.0F; });
  const MemoryStack mask({both, each_pixel(both, [](float) { return 0.0F; }), both});
  for (const Labels& one : {Labels{{1}}, Labels{{}, true}}) {
    options.mesh.segmentation = one;
    const Asset same = asset_of(mesh_stack(mask, options, {}));
    ASSERT_EQ(same.slices.size(), 3U);
    ASSERT_EQ(same.materials.size(), 1U);
    EXPECT_EQ(same.materials[0].name, "label 1");
    EXPECT_EQ(same.slices[0].mesh.vertices, joined.slices[0].mesh.vertices);
    EXPECT_EQ(same.slices[0].mesh.triangles, joined.slices[0].mesh.triangles);
  }
}

// If the label map has a CT, each material has its own HU: the mean of its pixels.
TEST(Materials, HaveTheirOwnHu) {
  const Image map = organs(96, 2);
  const MemoryStack stack = three_slices(map);
  const MemoryStack ct({each_pixel(map, [](float v) { return 100 * v; }),
                        each_pixel(map, [](float) { return 0.0F; }), each_pixel(map, [](float v) {
                          return v == 0 ? 0 : 100 * (kReversed - v);
                        })});
  StackOptions options = all_labels();
  options.mesh.hu = &ct;
  for (const bool field : {false, true}) {
    options.mesh.hu_field = field;
    const auto made = mesh_stack(stack, options, {});
    const Asset asset = asset_of(made);
    ASSERT_EQ(asset.materials.size(), static_cast<std::size_t>(2 * kMapLabels));
    for (const AssetSlice& slice : asset.slices) {
      if (slice.mesh.triangles.empty()) continue;
      const auto mean = test::take(mean_hu_of(slice));
      EXPECT_NEAR(mean,
                  100 * asset.materials[static_cast<std::size_t>(slice.material)].label.value_or(0),
                  field ? 30 : 0.01)
          << slice.index << ' ' << slice.material;
      EXPECT_EQ(slice.hu.empty(), !field);
    }
    Asset sheet = asset;
    ASSERT_TRUE(weld_materials(sheet, "ct.glb"));
    for (std::size_t i = 0, k = 0; k < 3; ++k) {
      double sum = 0, area = 0;
      const auto materials = materials_of_slice(asset, i);
      i += materials.size();
      for (const AssetSlice& one : materials) {
        const auto mm2 = static_cast<double>(doubled_area(one.mesh));
        sum += mm2 * mean_hu_of(one).value_or(0);
        area += mm2;
      }
      if (area == 0) continue;
      const auto mean = test::take(mean_hu_of(sheet.slices[k]));
      EXPECT_NEAR(mean, sum / area, field ? 10 : 0.1);
      EXPECT_EQ(sheet.slices[k].hu.size(), field ? sheet.slices[k].mesh.vertices.size() : 0U);
    }
  }
}

TEST(Materials, OfManyLabelsAreRefusedOrDropped) {
  const Image many = image_of(300, 300, [](int x, int y) { return 1 + x + 300 * y; });
  StackOptions options = all_labels(0);
  const auto refused = mesh_stack(MemoryStack({many}), options, {});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ExitCode::kRefused);
  EXPECT_NE(refused.error().message.find("more than 65535 labels"), std::string::npos)
      << refused.error().message;
  const Image fewer = image_of(60, 60, [](int x, int y) { return 1 + x / 3 + 20 * (y / 3); });
  const Asset asset = asset_of(mesh_stack(MemoryStack({fewer}), options, {}));
  EXPECT_EQ(asset.materials.size(), 400U);
  EXPECT_TRUE(verify_asset(asset, "many.glb"));
}

TEST(Materials, CannotFollowPixelCentresOrBeFilled) {
  StackOptions options = all_labels();
  options.mesh.contour = ContourKind::kPixel;
  const auto made = mesh_stack(three_slices(organs(96, 1)), options, {});
  ASSERT_FALSE(made);
  EXPECT_EQ(made.error().code, ExitCode::kUsage);
}

}  // namespace
}  // namespace trocar::pipeline
