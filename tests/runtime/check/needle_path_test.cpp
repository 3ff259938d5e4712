// SPDX-License-Identifier: Apache-2.0
#include "runtime/check/needle_path.h"

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

/// Squares of 40 mm around (80, 60) mm, 2 mm apart, in a patient who lies askew. `empty`: slices that have none.
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
  Result<NeedlePath> plan(std::array<double, 3> entry, std::optional<std::array<double, 3>> target,
                          const PathLimits& limits = {}) const {
    return plan_needle_path(asset, levels, {entry, target}, limits);
  }
  std::string refusal(std::array<double, 3> entry,
                      std::optional<std::array<double, 3>> target) const {
    const auto path = plan(entry, target);
    return path ? "" : path.error().message;
  }

  Asset asset;
  Eigen::Affine3d T_lps = Eigen::Affine3d::Identity();
  std::vector<Level> levels;
};

bool near(const Vector3d& a, const Vector3d& b) {
  return (a - b).norm() < 1e-9;
}

TEST(NeedlePath, GoesStraightDownWithoutATarget) {
  const Stack stack(10);
  const auto path = stack.plan(stack.lps(75, 66, 18), {});
  ASSERT_TRUE(path) << path.error().message;
  EXPECT_TRUE(near(path->entry_mm, {75, 66, 18}));
  EXPECT_TRUE(near(path->end_mm, {75, 66, 0}));
  EXPECT_TRUE(near(path->direction, {0, 0, -1}));
  EXPECT_EQ(tilt_deg(*path), 0);
  EXPECT_EQ(path->first, 0U);
  EXPECT_EQ(path->last, 9U);
  EXPECT_NEAR(path->thickness_mm, 20, 1e-9);
  EXPECT_FALSE(path->has_target);

  const auto within = stack.plan(stack.lps(75, 66, 18), {}, {.height_mm = 7});
  EXPECT_TRUE(within && near(within->end_mm, {75, 66, 12}));
}

TEST(NeedlePath, GoesFromEntryToTarget) {
  const Stack stack(10);
  const Vector3d entry(75, 66, 18), target(81, 58, 5);
  const auto path = stack.plan(stack.lps(75, 66, 18), stack.lps(81, 58, 5));
  ASSERT_TRUE(path) << path.error().message;
  EXPECT_TRUE(near(path->entry_mm, entry));
  EXPECT_TRUE(near(path->end_mm, target));
  EXPECT_TRUE(near(path->direction, (target - entry).normalized()));
  EXPECT_NEAR(tilt_deg(*path), std::atan2(10, 13) * 180 / M_PI, 1e-9);
  EXPECT_EQ(path->last, 6U) << "the level at 6 mm is the last above the target";
  EXPECT_TRUE(near(point_at(*path, 5), target));
}

TEST(NeedlePath, EntersWhereItMeetsTheBone) {
  const Stack stack(10);
  // Chosen inside the bone, above it, and between two levels.
  const auto inside = stack.plan(stack.lps(80, 60, 9), {});
  ASSERT_TRUE(inside) << inside.error().message;
  EXPECT_TRUE(near(inside->entry_mm, {80, 60, 18}));
  EXPECT_NEAR(inside->entry_shift_mm, 9, 1e-9);
  const auto above = stack.plan(stack.lps(80, 60, 30), stack.lps(80, 66, 6));
  ASSERT_TRUE(above) << above.error().message;
  EXPECT_TRUE(near(above->entry_mm, {80, 63, 18}));

  const Stack lower(
      10, {7, 8, 9});  // the topmost level is at 12 mm, and its surface within half a slice above
  const auto surface = lower.plan(lower.lps(80, 60, 12.9), {});
  EXPECT_TRUE(surface && near(surface->entry_mm, {80, 60, 12.9}));
  const auto air = lower.plan(lower.lps(80, 60, 13.5), {});
  EXPECT_TRUE(air && near(air->entry_mm, {80, 60, 12}));
}

TEST(NeedlePath, SlicesWithoutMaterialPartTheBone) {
  const Stack stack(10, {4, 5});
  EXPECT_NE(stack.refusal(stack.lps(80, 60, 6), {}).find("through the bone of slice 9"),
            std::string::npos);
  // Air above the lower piece, where the upper one is absent.
  Stack aside(10, {4, 5});
  for (std::size_t i = 6; i < 10; ++i) {
    for (LatticePoint& vertex : aside.asset.slices[i].mesh.vertices)
      vertex.x += static_cast<int>(60 / aside.asset.lattice.step_mm());
  }
  const auto path = aside.plan(aside.lps(80, 60, 9), {});
  ASSERT_TRUE(path) << path.error().message;
  EXPECT_TRUE(near(path->entry_mm, {80, 60, 6}));
  EXPECT_NEAR(path->entry_shift_mm, 3, 1e-9);
}

TEST(NeedlePath, NeedsSlicesStraightAboveEachOther) {
  Stack stack(10);
  for (AssetSlice& slice : stack.asset.slices)
    slice.T_lps_plane = slice.T_lps_plane * Eigen::Translation3d(0.1 * slice.index, 0, 0);
  EXPECT_NE(stack.refusal(stack.lps(80, 60, 18), {}).find("tilted gantry"), std::string::npos);
}

TEST(NeedlePath, KeepsASurfacePointBetweenLevels) {
  Stack stack(10);
  // Only the lower half of the stack has material at this point.
  for (AssetSlice& slice : stack.asset.slices) {
    if (slice.index < 5) continue;
    for (LatticePoint& vertex : slice.mesh.vertices)
      vertex.x += static_cast<int>(40 / stack.asset.lattice.step_mm());
  }
  const auto path = stack.plan(stack.lps(75, 60, 8.6), {});
  ASSERT_TRUE(path) << path.error().message;
  EXPECT_TRUE(near(path->entry_mm, {75, 60, 8.6}));
  EXPECT_EQ(path->entry_shift_mm, 0);
  EXPECT_EQ(stack.levels[path->first].slice->index, 4);
}

TEST(NeedlePath, SaysWhyThereIsNone) {
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

TEST(NeedlePath, EndsAtAGapThatIsTooWide) {
  const Stack stack(10, {4, 5});
  const auto path = stack.plan(stack.lps(80, 60, 18), {}, {.gap_mm = 3});
  ASSERT_TRUE(path) << path.error().message;
  EXPECT_TRUE(near(path->end_mm, {80, 60, 12}));
  EXPECT_EQ(path->max_gap_mm, 2);
  const auto through = stack.plan(stack.lps(80, 60, 18), stack.lps(80, 60, 1), {.gap_mm = 3});
  EXPECT_TRUE(through && through->max_gap_mm == 6);
}

TEST(NeedlePath, EndsAfterTheLargestNumberOfSlices) {
  const Stack stack(10, {7});  // the empty slice counts
  const std::pair<std::size_t, double> ends_mm[] = {{4, 12}, {3, 16}, {2, 16}};
  for (const auto& [slices, end_mm] : ends_mm) {
    const auto path = stack.plan(stack.lps(80, 60, 18), {}, {.slices = slices});
    ASSERT_TRUE(path) << path.error().message;
    EXPECT_TRUE(near(path->end_mm, {80, 60, end_mm})) << slices;
  }
  const auto path = stack.plan(stack.lps(80, 60, 18), stack.lps(80, 60, 1), {.slices = 4});
  ASSERT_TRUE(path) << path.error().message;
  EXPECT_EQ(slices_between(stack.levels[path->first], stack.levels[path->last]), 9U)
      << "a target is not given up";
}

TEST(NeedlePath, AGapOfMoreThanThreeMillimetresEndsTheBone) {
  // Levels 2 mm apart; some lie 60 mm aside, so that the path meets no bone there.
  const auto with_gap = [](int from, int to) {
    Stack stack(12);
    for (int i = from; i <= to; ++i)
      for (LatticePoint& vertex : stack.asset.slices[static_cast<std::size_t>(i)].mesh.vertices)
        vertex.x += static_cast<int>(60 / stack.asset.lattice.step_mm());
    return stack;
  };
  const Stack narrow = with_gap(5, 5), wide = with_gap(5, 6);
  const auto through = narrow.plan(narrow.lps(80, 60, 22), {});
  ASSERT_TRUE(through) << through.error().message;
  EXPECT_EQ(through->last, 11U) << "a gap of 2 mm";
  EXPECT_TRUE(bone_gaps(narrow.levels, *through).empty());
  const auto ended = wide.plan(wide.lps(80, 60, 22), {});
  ASSERT_TRUE(ended) << ended.error().message;
  EXPECT_EQ(ended->last, 4U) << "slice 7, above the gap of 4 mm";
  EXPECT_NEAR(ended->thickness_mm, 10, 1e-9);
  const std::vector<BoneGap> after = bone_gaps(wide.levels, *ended);
  ASSERT_EQ(after.size(), 1U);
  EXPECT_NEAR(after[0].mm, 4, 1e-9);
  EXPECT_EQ(after[0].above, ended->last);
  EXPECT_EQ(wide.levels[after[0].below].slice->index, 4);
  // To a target below the gap, which is then known; only bone counts.
  const auto chosen = wide.plan(wide.lps(80, 60, 22), wide.lps(80, 60, 1));
  ASSERT_TRUE(chosen) << chosen.error().message;
  EXPECT_EQ(bone_gaps(wide.levels, *chosen).size(), 1U);
  EXPECT_NEAR(chosen->thickness_mm, 18, 1e-9) << "without the last slice, below the target";

  const auto column = find_entry_column(wide.asset, wide.levels, 2, 100, 3);
  ASSERT_TRUE(column);
  EXPECT_NEAR(column->thickness_mm, 10, 1e-9) << "either piece has 10 mm; the upper one is met";
  EXPECT_EQ(column->first, 0U);
  EXPECT_EQ(column->last, 4U);
}

}  // namespace
}  // namespace trocar::runtime
