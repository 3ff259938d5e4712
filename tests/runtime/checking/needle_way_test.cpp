// SPDX-License-Identifier: Apache-2.0
#include "runtime/checking/needle_way.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/sheet_fixture.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;

constexpr double kAny = 1e9;

/// Squares of 40 mm around (80, 60) mm, 2 mm apart, in a patient who lies askew. The slices in `empty` have no material.
struct Stack {
  explicit Stack(int slices, const std::vector<int>& empty = {})
      : asset(test::square_asset(slices)) {
    T_lps.linear() = Eigen::AngleAxisd(0.7, Vector3d(1, 2, 3).normalized()).toRotationMatrix();
    T_lps.translation() = Vector3d(-31, 12, 250);
    for (AssetSlice& slice : asset.slices) {
      slice.z_mm = 2.0 * slice.index;
      slice.T_lps_plane = T_lps * Eigen::Translation3d(0, 0, slice.z_mm);
    }
    for (const int index : empty)
      asset.slices[static_cast<std::size_t>(index)].mesh.triangles.clear();
    for (auto slice = asset.slices.rbegin(); slice != asset.slices.rend(); ++slice) {
      if (!slice->mesh.triangles.empty()) levels.push_back({&*slice, slice->z_mm});
    }
  }

  std::array<double, 3> lps(double u, double v, double z) const {
    const Vector3d at = T_lps * Vector3d(u, v, z);
    return {at.x(), at.y(), at.z()};
  }
  Result<NeedleWay> plan(std::array<double, 3> entry, std::optional<std::array<double, 3>> target,
                         double height_mm = kAny, double gap_mm = kAny) const {
    return plan_needle_way(asset, levels, {entry, target}, height_mm, gap_mm);
  }
  std::string refusal(std::array<double, 3> entry,
                      std::optional<std::array<double, 3>> target) const {
    const auto way = plan(entry, target);
    return way ? "" : way.error().message;
  }

  Asset asset;
  Eigen::Affine3d T_lps = Eigen::Affine3d::Identity();
  std::vector<Level> levels;
};

bool near(const Vector3d& a, const Vector3d& b) {
  return (a - b).norm() < 1e-9;
}

TEST(NeedleWay, GoesStraightDownWithoutATarget) {
  const Stack stack(10);
  const auto way = stack.plan(stack.lps(75, 66, 18), {});
  ASSERT_TRUE(way) << way.error().message;
  EXPECT_TRUE(near(way->entry_mm, {75, 66, 18}));
  EXPECT_TRUE(near(way->end_mm, {75, 66, 0}));
  EXPECT_TRUE(near(way->direction, {0, 0, -1}));
  EXPECT_EQ(tilt_deg(*way), 0);
  EXPECT_EQ(way->first, 0U);
  EXPECT_EQ(way->last, 9U);
  EXPECT_NEAR(way->thickness_mm, 20, 1e-9);
  EXPECT_FALSE(way->has_target);

  const auto within = stack.plan(stack.lps(75, 66, 18), {}, 7);
  EXPECT_TRUE(within && near(within->end_mm, {75, 66, 12}));
}

TEST(NeedleWay, GoesFromEntryToTarget) {
  const Stack stack(10);
  const Vector3d entry(75, 66, 18), target(81, 58, 5);
  const auto way = stack.plan(stack.lps(75, 66, 18), stack.lps(81, 58, 5));
  ASSERT_TRUE(way) << way.error().message;
  EXPECT_TRUE(near(way->entry_mm, entry));
  EXPECT_TRUE(near(way->end_mm, target));
  EXPECT_TRUE(near(way->direction, (target - entry).normalized()));
  EXPECT_NEAR(tilt_deg(*way), std::atan2(10, 13) * 180 / M_PI, 1e-9);
  EXPECT_EQ(way->last, 6U) << "the level at 6 mm is the last above the target";
  EXPECT_TRUE(near(point_at(*way, 5), target));
}

TEST(NeedleWay, EntersWhereItMeetsTheBone) {
  const Stack stack(10);
  // Chosen inside the bone, above it, and between two levels.
  const auto inside = stack.plan(stack.lps(80, 60, 9), {});
  ASSERT_TRUE(inside) << inside.error().message;
  EXPECT_TRUE(near(inside->entry_mm, {80, 60, 18}));
  EXPECT_NEAR(inside->moved_mm, 9, 1e-9);
  const auto above = stack.plan(stack.lps(80, 60, 30), stack.lps(80, 66, 6));
  ASSERT_TRUE(above) << above.error().message;
  EXPECT_TRUE(near(above->entry_mm, {80, 63, 18}));

  const Stack apart(10, {7, 8, 9});  // the topmost level is at 12 mm
  const auto surface = apart.plan(apart.lps(80, 60, 12.9), {});
  EXPECT_TRUE(surface && near(surface->entry_mm, {80, 60, 12}));
}

TEST(NeedleWay, KeepsASurfacePointBetweenLevels) {
  Stack stack(10);
  // Only the lower half of the stack has material at this point.
  for (AssetSlice& slice : stack.asset.slices) {
    if (slice.index < 5) continue;
    for (LatticePoint& vertex : slice.mesh.vertices)
      vertex.x += static_cast<int>(40 / stack.asset.lattice.step_mm());
  }
  const auto way = stack.plan(stack.lps(75, 60, 8.6), {});
  ASSERT_TRUE(way) << way.error().message;
  EXPECT_TRUE(near(way->entry_mm, {75, 60, 8.6}));
  EXPECT_EQ(way->moved_mm, 0);
  EXPECT_EQ(stack.levels[way->first].slice->index, 4);
}

TEST(NeedleWay, SaysWhyThereIsNone) {
  Stack stack(10);
  EXPECT_NE(
      stack.refusal(stack.lps(80, 60, 5), stack.lps(80, 60, 8)).find("is not below the entry"),
      std::string::npos);
  EXPECT_NE(stack.refusal(stack.lps(20, 60, 18), {}).find("meets no bone"), std::string::npos);
  EXPECT_NE(stack.refusal(stack.lps(80, 60, 40), stack.lps(80, 60, 30)).find("above the bone"),
            std::string::npos);
  // The slices from 5 to 7 have their material elsewhere, so the bone is in two pieces there.
  for (std::size_t i = 5; i < 8; ++i) {
    for (LatticePoint& vertex : stack.asset.slices[i].mesh.vertices)
      vertex.x += static_cast<int>(60 / stack.asset.lattice.step_mm());
  }
  EXPECT_NE(stack.refusal(stack.lps(80, 60, 8), {}).find("through the bone of slice 9"),
            std::string::npos);
  EXPECT_TRUE(stack.plan(stack.lps(80, 60, 18), {}));
}

TEST(NeedleWay, EndsAtAGapThatIsTooWide) {
  const Stack stack(10, {4, 5});
  const auto way = stack.plan(stack.lps(80, 60, 18), {}, kAny, 3);
  ASSERT_TRUE(way) << way.error().message;
  EXPECT_TRUE(near(way->end_mm, {80, 60, 12}));
  EXPECT_EQ(way->max_gap_mm, 2);
  const auto through = stack.plan(stack.lps(80, 60, 18), stack.lps(80, 60, 1), kAny, 3);
  EXPECT_TRUE(through && through->max_gap_mm == 6);
}

}  // namespace
}  // namespace trocar::runtime
