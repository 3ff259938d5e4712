// SPDX-License-Identifier: Apache-2.0
// The tool's prism and its section with a sheet (runtime/haptics/tool.h).
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "formats/mesh/mesh_validity.h"
#include "runtime/haptics/tool.h"
#include "tests/runtime/haptics/contact_fixture.h"

namespace trocar::runtime {
namespace {

TEST(ToolOutline, IsSimpleWhereTheClearanceAllowsIt) {
  std::mt19937_64 random(3);
  int narrow = 0;
  for (int i = 0; i < 5000; ++i) {
    SceneTool shape;
    shape.sides = 3 + static_cast<int>(random() % 30);
    shape.radius_m = uniform(random, 0.0001, 0.003);
    if (i % 3 == 0) {
      shape = arrow();
      for (auto& p : shape.outline_m)
        p = {0.2 * p[0], 0.2 * p[1]};
    }
    shape.tilt_deg = uniform(random, 0, 45);
    shape.tilt_azimuth_deg = uniform(random, 0, 360);
    const Tool tool = make_tool(shape);
    PlanarTransform transform;
    transform.lattice.bits = static_cast<int>(random() % 9);
    if (smallest_clearance_m(tool) < kMinClearance * transform.lattice.step_m()) {
      ++narrow;
      continue;
    }
    const LatticeOutline outline =
        outline_on_lattice(tool, at(0, 0, 0, uniform(random, 0, 7)), transform, 0.01);
    ASSERT_EQ(outline.size, tool.sides);
    for (int k = 0; k < outline.size; ++k) {
      for (int j = 0; j < k; ++j) {
        ASSERT_NE(outline.points[j], outline.points[k]);
        ASSERT_FALSE(segments_cross(outline.points[j], outline.points[(j + 1) % outline.size],
                                    outline.points[k], outline.points[(k + 1) % outline.size]));
      }
    }
    ASSERT_GT(doubled_area(to_ring(outline)), 0);
  }
  EXPECT_GT(narrow, 100);
  EXPECT_LT(narrow, 4000);
}

TEST(ToolOutline, IsTheSectionOfThePrismWithTheSheet) {
  // The section's points, projected along the axis, are the corners of the cross-section.
  std::mt19937_64 random(5);
  for (int i = 0; i < 1000; ++i) {
    SceneTool shape;
    shape.radius_m = 0.01;
    shape.tilt_deg = uniform(random, 0, 35);
    shape.tilt_azimuth_deg = uniform(random, 0, 360);
    shape.tip_in_plate_m = {0.01, -0.02, 0.03};
    const Tool tool = make_tool(shape);
    Pose pose;
    pose.p_m = {uniform(random, -0.02, 0.02), uniform(random, -0.02, 0.02), 0.1};
    pose.q = Eigen::AngleAxisd(
        0.15, Eigen::Vector3d(uniform(random, -1, 1), uniform(random, -1, 1), 0.3).normalized());
    PlanarTransform transform;
    const double z_m = uniform(random, 0.08, 0.12);
    const LatticeOutline outline = outline_on_lattice(tool, pose, transform, z_m);
    ASSERT_EQ(outline.size, 6);
    const Eigen::Vector3d axis = pose.q * tool.axis_plate, at_m = axis_at(tool, pose, z_m);
    EXPECT_NEAR(at_m.z(), z_m, 1e-15);
    EXPECT_LT((at_m - pose * tool.tip_plate_m).cross(axis).norm(), 1e-15);
    for (int k = 0; k < 6; ++k) {
      const Eigen::Vector2d xy = transform.to_scene({outline.points[k].x, outline.points[k].y});
      const Eigen::Vector3d from_axis = Eigen::Vector3d(xy.x(), xy.y(), z_m) - at_m;
      const Eigen::Vector3d across = from_axis - from_axis.dot(axis) * axis;
      const Eigen::Vector3d corner = pose.q * (tool.corner_plate_m[k] - tool.tip_plate_m);
      ASSERT_LT((across - corner).norm(), 2 * transform.lattice.step_m());
    }
  }
}

TEST(ToolOutline, PiecesTileTheCrossSection) {
  SceneTool star;
  for (int k = 0; k < 10; ++k) {
    const double r = k % 2 == 0 ? 0.004 : 0.0015, angle = 2 * std::numbers::pi * k / 10;
    star.outline_m.push_back({r * std::cos(angle), r * std::sin(angle)});
  }
  for (const SceneTool& shape : {star, arrow(), SceneTool{}}) {
    const Tool tool = make_tool(shape);
    ASSERT_GT(tool.pieces, 0);
    const auto cross = [&](int i, int j, int k) {
      return (tool.corner_plate_m[j] - tool.corner_plate_m[i])
          .cross(tool.corner_plate_m[k] - tool.corner_plate_m[i])
          .z();
    };
    double whole = 0, sum = 0;
    for (int i = 2; i < tool.sides; ++i)
      whole += cross(0, i - 1, i);
    for (int p = 0; p < tool.pieces; ++p) {
      const ConvexPiece& piece = tool.piece[p];
      for (int i = 0; i < piece.size; ++i) {
        EXPECT_GE(cross(piece.corner[i], piece.corner[(i + 1) % piece.size],
                        piece.corner[(i + 2) % piece.size]),
                  0);
      }
      for (int i = 2; i < piece.size; ++i)
        sum += cross(piece.corner[0], piece.corner[i - 1], piece.corner[i]);
    }
    EXPECT_NEAR(sum, whole, 1e-12 * whole);
  }
  EXPECT_EQ(make_tool(SceneTool{}).pieces, 1);
  SceneTool comb;  // 15 teeth: more than kMaxToolPieces parts
  for (int k = 0; k < 15; ++k) {
    comb.outline_m.push_back({0.001 * k, -0.002});
    comb.outline_m.push_back({0.001 * k + 0.0005, 0});
  }
  comb.outline_m.push_back({0.02, 0.004});
  comb.outline_m.push_back({-0.002, 0.004});
  EXPECT_EQ(make_tool(comb).pieces, 0);
}

TEST(ToolOutline, TransformAndItsInverseCancel) {
  PlanarTransform transform;
  transform.at_m = {0.01, -0.02};
  transform.anchor_mm = {80, 72};
  transform.cosine = std::cos(0.7);
  transform.sine = std::sin(0.7);
  const Eigen::Vector2d p(0.013, 0.004);
  EXPECT_LT((transform.to_scene(transform.to_lattice(p)) - p).norm(), 1e-15);
  EXPECT_LT((transform.to_lattice(transform.at_m) - transform.anchor_mm * 256).norm(), 1e-9);
  // x is u rotated by +0.7: one mm along u.
  const Eigen::Vector2d u = transform.to_scene({256 * 81, 256 * 72}) - transform.at_m;
  EXPECT_LT((u - Eigen::Vector2d(std::cos(0.7), std::sin(0.7)) * 1e-3).norm(), 1e-15);
}

}  // namespace
}  // namespace trocar::runtime
