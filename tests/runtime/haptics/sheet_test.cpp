// SPDX-License-Identifier: Apache-2.0
// Slices as sheets: placing, tissue, distance to the outline, and the raster of material and HU.
#include "runtime/haptics/sheet.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

#include "formats/mesh/lattice.h"
#include "runtime/haptics/slice_field.h"
#include "tests/support/counted_allocations.h"
#include "tests/support/random_geometry.h"
#include "tests/support/sheet_fixture.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;

// A scene's slices as sheets, each with its tissue (runtime/haptics/sheet.h, tissue_choice.h).

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

// The raster of distances to an outline against the distance to each edge in turn.

constexpr double kLattice_mm = 1.0 / 256, kReach_mm = EdgeDistance::kReach_mm;

/// Distance to the nearest edge, positive inside; inside by the sum of the angles.
double by_edges(const Pslg& outline, const Vector2d& p_mm) {
  double nearest_mm = kReach_mm, turns = 0;
  for (const Ring& ring : outline.rings) {
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const LatticePoint from = ring[i], to = ring[(i + 1) % ring.size()];
      const Vector2d a = Vector2d(from.x, from.y) * kLattice_mm - p_mm,
                     b = Vector2d(to.x, to.y) * kLattice_mm - p_mm, ab = b - a;
      const double part = std::clamp(-a.dot(ab) / ab.squaredNorm(), 0.0, 1.0);
      nearest_mm = std::min(nearest_mm, (a + part * ab).norm());
      turns += std::atan2(a.x() * b.y() - a.y() * b.x(), a.dot(b));
    }
  }
  return turns > 3 ? nearest_mm : -nearest_mm;
}

PlanarTransform placed_at_angle(double angle) {
  PlanarTransform transform;
  transform.anchor_mm = {3.5, -2};
  transform.at_m = {0.004, 0.011};
  transform.cosine = std::cos(angle);
  transform.sine = std::sin(angle);
  return transform;
}

double distance_mm(const EdgeDistance& edge, const PlanarTransform& transform,
                   const Vector2d& p_mm) {
  return 1e3 * edge.at(transform, transform.to_scene(p_mm / kLattice_mm)).distance_m;
}

TEST(EdgeDistance, IsThatOfTheNearestEdge) {
  Random random(3);
  for (int trial = 0; trial < 10; ++trial) {
    Pslg outline{{star(random, {300 * trial, -200}, 1500, 3500, 12)}};
    Ring hole = star(random, {300 * trial, -200}, 300, 900, 7);
    std::reverse(hole.begin(), hole.end());
    outline.rings.push_back(hole);
    const PlanarTransform transform = placed_at_angle(0.7 * trial);
    const EdgeDistance edge(outline, transform.lattice);
    const LatticeBox box = box_around(std::span<const LatticePoint>(outline.rings[0]));
    const Vector2d corner_mm =
        Vector2d(box.low.x, box.low.y) * kLattice_mm - Vector2d::Constant(kReach_mm);
    for (int k = 0; k < 500; ++k) {
      const Vector2d node_mm =
          corner_mm +
          EdgeDistance::kSpacing_mm * Vector2d(random.between(0, 50), random.between(0, 50));
      ASSERT_NEAR(distance_mm(edge, transform, node_mm), by_edges(outline, node_mm), 1e-5);
    }
    int inside = 0, near = 0;
    for (int k = 0; k < 3000; ++k) {
      const Vector2d p_mm(300 * trial * kLattice_mm + 40 * (random.unit() - 0.5),
                          40 * (random.unit() - 0.5));
      const double wanted_mm = by_edges(outline, p_mm), got_mm = distance_mm(edge, transform, p_mm);
      // Bilinear between exact values of a function whose slope is at most 1.
      ASSERT_NEAR(got_mm, wanted_mm, EdgeDistance::kSpacing_mm)
          << trial << ": " << p_mm.transpose();
      inside += wanted_mm > 0;
      near += std::abs(wanted_mm) < kReach_mm;
    }
    EXPECT_GT(inside, 200);
    EXPECT_GT(near, 800);
  }
}

TEST(EdgeDistance, IsExactBesideAStraightEdgeInEveryDirection) {
  const int size = 40 * 256;
  const EdgeDistance edge({{{{-size, -size}, {size, -size}, {size, size}, {-size, size}}}},
                          Lattice{});
  Random random(4);
  for (int k = 0; k < 500; ++k) {
    const PlanarTransform transform = placed_at_angle(6.3 * random.unit());
    const Vector2d p_mm(40 + 3.4 * (2 * random.unit() - 1), 30 * (2 * random.unit() - 1));
    const EdgeDistance::Sample got = edge.at(transform, transform.to_scene(p_mm / kLattice_mm));
    ASSERT_NEAR(1e3 * got.distance_m, 40 - p_mm.x(), 1e-5);
    ASSERT_NEAR((got.gradient - Vector2d(-transform.cosine, -transform.sine)).norm(), 0, 1e-5);
  }
}

TEST(EdgeDistance, IsLimitedFarFromTheEdgeAndOutside) {
  const EdgeDistance edge({{{{0, 0}, {12 * 256, 0}, {12 * 256, 12 * 256}, {0, 12 * 256}}}},
                          Lattice{});
  const PlanarTransform plain;
  EXPECT_EQ(distance_mm(edge, plain, {6, 6}), kReach_mm);
  EXPECT_EQ(distance_mm(edge, plain, {200, 6}), -kReach_mm);
  EXPECT_EQ(distance_mm(edge, plain, {6, -1e9}), -kReach_mm);
  EXPECT_EQ(distance_mm(EdgeDistance(), plain, {0, 0}), -kReach_mm);
  EXPECT_EQ(distance_mm(EdgeDistance(Pslg{}, Lattice{}), plain, {0, 0}), -kReach_mm);
  EXPECT_EQ(edge.at(plain, {0.2, 0.006}).gradient.norm(), 0);
}

TEST(EdgeDistance, AWideSliceHasACoarserRaster) {
  const int size = 500 * 256;
  const EdgeDistance edge({{{{0, 0}, {size, 0}, {size, size}, {0, size}}}}, Lattice{});
  EXPECT_NEAR(distance_mm(edge, PlanarTransform{}, {2, 250}), 2, 1e-4);
}

TEST(EdgeDistance, ReadsWithoutAllocation) {
  TROCAR_NEEDS_COUNTED_ALLOCATIONS();
  const EdgeDistance edge({{{{0, 0}, {2560, 0}, {2560, 2560}, {0, 2560}}}}, Lattice{});
  const PlanarTransform plain;
  const std::uint64_t before = allocations_in_scopes();
  double sum = 0;
  {
    const NoAllocationScope scope;
    for (int k = 0; k < 1000; ++k)
      sum += edge.at(plain, {1e-5 * k, 0.002}).distance_m;
  }
  EXPECT_NE(sum, 0);
  EXPECT_EQ(allocations_in_scopes(), before);
}

// The raster of a slice's material and HU against its triangles, point by point.

constexpr double kStep_mm = 1.0 / 256;

/// HU at a point of the slice plane, in mm, by the triangle around it; none: outside of material.
std::optional<double> by_triangles(const SliceMesh& mesh, const std::vector<float>& hu, double x_mm,
                                   double y_mm) {
  const long double x = x_mm / kStep_mm, y = y_mm / kStep_mm;
  for (const Triangle& t : mesh.triangles) {
    const LatticePoint a = mesh.vertices[t[0]], b = mesh.vertices[t[1]], c = mesh.vertices[t[2]];
    const auto doubled = [](long double ax, long double ay, long double bx, long double by,
                            long double cx, long double cy) {
      return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
    };
    const long double all = doubled(a.x, a.y, b.x, b.y, c.x, c.y),
                      of_a = doubled(x, y, b.x, b.y, c.x, c.y) / all,
                      of_b = doubled(a.x, a.y, x, y, c.x, c.y) / all, of_c = 1 - of_a - of_b;
    if (of_a < 0 || of_b < 0 || of_c < 0) continue;
    if (hu.empty()) return 0;
    return static_cast<double>(of_a * hu[t[0]] + of_b * hu[t[1]] + of_c * hu[t[2]]);
  }
  return std::nullopt;
}

/// Vertices moved at random by less than would turn a triangle over.
SliceMesh shaken(SliceMesh mesh, Random& random, int most) {
  for (LatticePoint& p : mesh.vertices) {
    p.x += random.between(-most, most);
    p.y += random.between(-most, most);
  }
  return mesh;
}

PlanarTransform plain() {
  return {};
}

/// At a point of the slice plane in mm.
SliceField::Mean mean_at(const SliceField& field, const PlanarTransform& transform, double x_mm,
                         double y_mm, double radius_m = 0) {
  return field.mean(transform, transform.to_scene(Vector2d(x_mm, y_mm) / kStep_mm), radius_m);
}

TEST(SliceField, APixelIsThatOfTheTriangleUnderItsMiddle) {
  Random random(1);
  for (int trial = 0; trial < 20; ++trial) {
    const LatticePoint origin{random.between(-9000, 9000), random.between(-9000, 9000)};
    const SliceMesh mesh = shaken(test::square_mesh(origin, 700, 5), random, 150);
    std::vector<float> hu(mesh.vertices.size());
    for (float& value : hu)
      value = static_cast<float>(random.between(-500, 2500));
    const bool has_hu = trial % 4 != 3;
    if (!has_hu) hu.clear();
    const PlanarTransform transform = placed_at_angle(0.1 * trial);
    const SliceField field(mesh, hu, transform.lattice);
    EXPECT_EQ(field.has_hu(), has_hu);
    const LatticeBox box = box_around(std::span<const LatticePoint>(mesh.vertices));
    int with = 0, without = 0;
    double sum = 0;
    for (int r = -2; r < 64; ++r) {
      for (int c = -2; c < 64; ++c) {
        const double x_mm = box.low.x * kStep_mm + (c + 0.5) * SliceField::kPixel_mm,
                     y_mm = box.low.y * kStep_mm + (r + 0.5) * SliceField::kPixel_mm;
        const auto wanted = by_triangles(mesh, hu, x_mm, y_mm);
        // Wherever in the pixel.
        const double dx_mm = 0.12 * (2 * random.unit() - 1), dy_mm = 0.12 * (2 * random.unit() - 1);
        const SliceField::Mean got = mean_at(field, transform, x_mm + dx_mm, y_mm + dy_mm);
        ASSERT_EQ(got.share, wanted ? 1 : 0) << trial << ": " << x_mm << ", " << y_mm;
        ASSERT_NEAR(got.hu, wanted.value_or(0), 1e-3) << trial << ": " << x_mm << ", " << y_mm;
        ++(wanted ? with : without);
        sum += wanted.value_or(0);
      }
    }
    EXPECT_GT(with, 1000);
    EXPECT_GT(without, 500);
    if (has_hu) {
      EXPECT_NEAR(field.mean_hu(), sum / with, 1e-3 * std::abs(sum / with) + 0.1);
    }
  }
}

TEST(SliceField, PixelsAreLargerOnlyWhereThereWouldBeTooMany) {
  const auto field_of = [](double width_mm) {
    const auto cell = static_cast<std::int32_t>(width_mm * 256 / 4);
    return SliceField(test::square_mesh({0, 0}, cell, 4), {}, Lattice{});
  };
  // 100 mm in pixels of a quarter: 400 of them, and one that begins at the far edge.
  EXPECT_EQ(field_of(100).pixels(), 401U * 401U);
  EXPECT_EQ(field_of(25).pixels(), 101U * 101U);
  const SliceField wide = field_of(400);
  EXPECT_GT(wide.pixels(), 0.9 * SliceField::kMaxPixels);
  EXPECT_LT(wide.pixels(), 1.01 * SliceField::kMaxPixels);
  EXPECT_EQ(mean_at(wide, plain(), 399, 399).share, 1);
  EXPECT_EQ(mean_at(wide, plain(), 401, 200).share, 0);
}

TEST(SliceField, ADiscsMeanIsThatOfItsArea) {
  const SliceMesh mesh = test::square_mesh({-20 * 256, -20 * 256}, 64, 160);
  std::vector<float> ramp, bowl;
  for (const LatticePoint p : mesh.vertices) {
    const double x_mm = p.x * kStep_mm, y_mm = p.y * kStep_mm;
    ramp.push_back(static_cast<float>(500 + 20 * x_mm - 10 * y_mm));
    bowl.push_back(static_cast<float>(x_mm * x_mm + y_mm * y_mm));
  }
  const SliceField of_ramp(mesh, ramp, Lattice{}), of_bowl(mesh, bowl, Lattice{});
  for (const double radius_mm : {1.0, 3.0, 6.0}) {
    const SliceField::Mean flat = mean_at(of_ramp, plain(), 2, 3, radius_mm * 1e-3);
    EXPECT_EQ(flat.share, 1);
    // A pixel's value is that of its middle: half a pixel in each direction.
    EXPECT_NEAR(flat.hu, 500 + 40 - 30, 0.5 * 0.25 * 30);
    const double r2 = mean_at(of_bowl, plain(), 0, 0, radius_mm * 1e-3).hu;
    EXPECT_NEAR(r2, radius_mm * radius_mm / 2, 0.04 * radius_mm * radius_mm + 0.02) << radius_mm;
  }
  // Over an edge the HU are those of the part over material.
  const SliceField::Mean half = mean_at(of_ramp, plain(), 20, 0, 3e-3);
  EXPECT_NEAR(half.share, 0.5, 2.0 / 19);
  EXPECT_NEAR(half.hu, 500 + 20 * (20 - 4 * 3 / (3 * std::numbers::pi)), 10);
  const SliceField::Mean none = mean_at(of_ramp, plain(), 24, 0, 3e-3);
  EXPECT_EQ(none.share, 0);
  EXPECT_EQ(none.hu, 0);
}

TEST(SliceField, TheMeanHuIsThatOfAllMaterial) {
  const SliceMesh mesh = test::square_mesh({0, 0}, 256, 40);
  std::vector<float> hu;
  for (const LatticePoint p : mesh.vertices)
    hu.push_back(static_cast<float>(25.0 * p.x * kStep_mm));  // 0 to 1000
  const SliceField field(mesh, hu, Lattice{});
  EXPECT_NEAR(field.mean_hu(), 500, 0.5);
}

TEST(SliceField, AnEmptySliceHasNoMaterial) {
  const SliceField none({}, {}, Lattice{});
  EXPECT_EQ(mean_at(none, plain(), 0, 0, 1e-3).share, 0);
  EXPECT_EQ(mean_at(SliceField(), plain(), 0, 0).share, 0);
  const SliceField some(test::square_mesh({0, 0}, 256, 10), {}, Lattice{});
  for (const double far : {1e9, -1e9, std::nan("")})
    EXPECT_EQ(some.mean(plain(), Vector2d(far, 0), 1e-3).share, 0);
}

TEST(SliceField, TheMeanIsReadWithoutAllocation) {
  TROCAR_NEEDS_COUNTED_ALLOCATIONS();
  const SliceField field(test::square_mesh({0, 0}, 256, 10), {}, Lattice{});
  const std::uint64_t before = allocations_in_scopes();
  double share = 0;
  {
    const NoAllocationScope scope;
    for (int i = 0; i < 100; ++i)
      share += mean_at(field, plain(), 0.1 * i, 5, 2e-3).share;
  }
  EXPECT_GT(share, 50);
  EXPECT_EQ(allocations_in_scopes(), before);
}

}  // namespace
}  // namespace trocar::runtime
