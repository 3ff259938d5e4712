// SPDX-License-Identifier: Apache-2.0
// The raster of a slice's material and HU against its triangles, point by point.
#include "runtime/haptics/slice_field.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

#include "tests/support/counted_allocations.h"
#include "tests/support/random_geometry.h"
#include "tests/support/sheet_fixture.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;

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
SliceField::Mean at(const SliceField& field, const PlanarTransform& transform, double x_mm,
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
    PlanarTransform transform;
    transform.anchor_mm = {3.5, -2};
    transform.at_m = {0.004, 0.011};
    transform.cosine = std::cos(0.1 * trial);
    transform.sine = std::sin(0.1 * trial);
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
        const SliceField::Mean got = at(field, transform, x_mm + dx_mm, y_mm + dy_mm);
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
  EXPECT_EQ(field_of(100).bytes(), 401U * 401U * sizeof(float));
  EXPECT_EQ(field_of(25).bytes(), 101U * 101U * sizeof(float));
  const SliceField wide = field_of(400);
  EXPECT_GT(wide.bytes(), 0.9 * SliceField::kMaxPixels * sizeof(float));
  EXPECT_LT(wide.bytes(), 1.01 * SliceField::kMaxPixels * sizeof(float));
  EXPECT_EQ(at(wide, plain(), 399, 399).share, 1);
  EXPECT_EQ(at(wide, plain(), 401, 200).share, 0);
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
    const SliceField::Mean flat = at(of_ramp, plain(), 2, 3, radius_mm * 1e-3);
    EXPECT_EQ(flat.share, 1);
    // A pixel's value is that of its middle: half a pixel in each direction.
    EXPECT_NEAR(flat.hu, 500 + 40 - 30, 0.5 * 0.25 * 30);
    const double r2 = at(of_bowl, plain(), 0, 0, radius_mm * 1e-3).hu;
    EXPECT_NEAR(r2, radius_mm * radius_mm / 2, 0.04 * radius_mm * radius_mm + 0.02) << radius_mm;
  }
  // Over an edge the HU are those of the part over material.
  const SliceField::Mean half = at(of_ramp, plain(), 20, 0, 3e-3);
  EXPECT_NEAR(half.share, 0.5, 2.0 / 19);
  EXPECT_NEAR(half.hu, 500 + 20 * (20 - 4 * 3 / (3 * std::numbers::pi)), 10);
  const SliceField::Mean none = at(of_ramp, plain(), 24, 0, 3e-3);
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
  EXPECT_EQ(at(none, plain(), 0, 0, 1e-3).share, 0);
  EXPECT_EQ(at(SliceField(), plain(), 0, 0).share, 0);
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
      share += at(field, plain(), 0.1 * i, 5, 2e-3).share;
  }
  EXPECT_GT(share, 50);
  EXPECT_EQ(allocations_in_scopes(), before);
}

}  // namespace
}  // namespace trocar::runtime
