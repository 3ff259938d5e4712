// SPDX-License-Identifier: Apache-2.0
// The tool: its outline in a sheet, its coverage, and its shaft in holes.
#include "runtime/haptics/tool.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>
#include <random>
#include <set>
#include <vector>

#include "formats/mesh/mesh_validity.h"
#include "runtime/haptics/sheet.h"
#include "tests/runtime/haptics/contact_fixture.h"

namespace trocar::runtime {
namespace {

// The tool's prism and its section with a sheet (runtime/haptics/tool.h).

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

// The shares of the tool outline of runtime/haptics/sheet.h, compared with areas
// found by integration.

using LongPolygon = std::vector<Eigen::Matrix<long double, 2, 1>>;

LongPolygon polygon(const LatticeOutline& outline) {
  LongPolygon result;
  for (int i = 0; i < outline.size; ++i) {
    result.emplace_back(outline.points[i].x, outline.points[i].y);
  }
  return result;
}

/// Area of the intersection of convex polygons, without clipping: integrates its width over y
/// between all heights where the width can have a kink.
long double intersection_area(const std::vector<LongPolygon>& convex) {
  std::set<long double> kinks;
  const auto crossings = [&](const LongPolygon& p, const LongPolygon& q) {
    for (std::size_t i = 0; i < p.size(); ++i) {
      const auto &a = p[i], &b = p[(i + 1) % p.size()];
      for (std::size_t j = 0; j < q.size(); ++j) {
        const auto &c = q[j], &d = q[(j + 1) % q.size()];
        const auto r = (b - a).eval(), s = (d - c).eval();
        const long double cross = r.x() * s.y() - r.y() * s.x();
        if (cross == 0) continue;
        const auto ca = (c - a).eval();
        kinks.insert(a.y() + r.y() * (ca.x() * s.y() - ca.y() * s.x()) / cross);
      }
    }
  };
  long double bottom = -1e30L, top = 1e30L;
  for (std::size_t i = 0; i < convex.size(); ++i) {
    long double low = 1e30L, high = -1e30L;
    for (const auto& p : convex[i]) {
      kinks.insert(p.y());
      low = std::min(low, p.y());
      high = std::max(high, p.y());
    }
    bottom = std::max(bottom, low);
    top = std::min(top, high);
    for (std::size_t j = 0; j < i; ++j)
      crossings(convex[i], convex[j]);
  }
  const auto width = [&](long double y) {
    long double left = -1e30L, right = 1e30L;
    for (const LongPolygon& p : convex) {
      long double own_left = 1e30L, own_right = -1e30L;
      for (std::size_t i = 0; i < p.size(); ++i) {
        const auto &a = p[i], &b = p[(i + 1) % p.size()];
        if ((a.y() - y) * (b.y() - y) > 0) continue;
        const long double x =
            a.y() == b.y() ? a.x() : a.x() + (b.x() - a.x()) * (y - a.y()) / (b.y() - a.y());
        own_left = std::min(own_left, x);
        own_right = std::max(own_right, x);
      }
      left = std::max(left, own_left);
      right = std::min(right, own_right);
    }
    return std::max(0.0L, right - left);
  };
  long double area = 0, last = bottom;
  const auto add = [&](long double to) {
    // The width is linear in between, so its value in the middle gives the exact area.
    if (to > last) area += (to - last) * width((last + to) / 2);
    last = std::max(last, to);
  };
  if (top <= bottom) return 0;
  for (const long double y : kinks) {
    if (y > bottom && y < top) add(y);
  }
  add(top);
  return area;
}

class OverlapTest : public ContactTest {};

TEST_F(OverlapTest, OverlapIsTheSharedArea) {
  // The sheet is a square: the intersection of tool and square is the expected area, which
  // overlap() sums over triangles.
  std::mt19937_64 random(1);
  LatticeOutline square;
  square.size = 4;
  const int low_x = 60 * 256, low_y = 40 * 256, side = 40 * 256;
  square.points[0] = {low_x, low_y};
  square.points[1] = {low_x + side, low_y};
  square.points[2] = {low_x + side, low_y + side};
  square.points[3] = {low_x, low_y + side};
  int partial = 0;
  for (int i = 0; i < 2000; ++i) {
    SceneTool shape;
    shape.sides = 3 + static_cast<int>(random() % 30);
    shape.radius_m = uniform(random, 0.001, 0.03);
    const Pose pose =
        at(uniform(random, -0.03, 0.03), uniform(random, -0.03, 0.03), 0.1, uniform(random, 0, 7));
    const LatticeOutline outline =
        outline_on_lattice(make_tool(shape), pose, sheets_[0]->transform, kTop_m);
    ASSERT_EQ(outline.size, shape.sides);
    const long double expected =
        intersection_area({polygon(outline), polygon(square)}) / area(outline);
    model_.tool = make_tool(shape);
    const double got = overlap_at(outline);
    ASSERT_NEAR(got, static_cast<double>(expected), 3e-9) << i;
    partial += got > 0 && got < 1;
  }
  EXPECT_GT(partial, 200);
}

TEST_F(OverlapTest, PendingHolesAreTakenOffOnce) {
  // Compared with inclusion and exclusion over up to three holes that may overlap.
  std::mt19937_64 random(2);
  for (int i = 0; i < 500; ++i) {
    std::array<LatticeOutline, 4> outlines;  // the tool, three holes
    SceneTool shape;
    shape.sides = 3 + static_cast<int>(random() % 8);
    model_.tool = make_tool(shape);
    for (LatticeOutline& outline : outlines) {
      outline = outline_on_lattice(model_.tool,
                                   at(uniform(random, -0.004, 0.004),
                                      uniform(random, -0.004, 0.004), 0.1, uniform(random, 0, 7)),
                                   sheets_[0]->transform, kTop_m);
    }
    const std::size_t holes = random() % 4;
    long double expected = 0;
    for (std::size_t subset = 0; subset < (std::size_t{1} << holes); ++subset) {
      std::vector<LongPolygon> shared = {polygon(outlines[0])};
      for (std::size_t h = 0; h < holes; ++h) {
        if (((subset >> h) & 1) != 0) shared.push_back(polygon(outlines[h + 1]));
      }
      expected += (shared.size() % 2 == 1 ? 1 : -1) * intersection_area(shared);
    }
    expected /= area(outlines[0]);
    const auto open = std::span<const LatticeOutline>(outlines).subspan(1, holes);
    ASSERT_NEAR(overlap_at(outlines[0], open), static_cast<double>(expected), 3e-9) << i;
    ASSERT_NEAR(outline_outside(model_.tool, outlines[0], open), static_cast<double>(expected),
                3e-9)
        << i << ": all of the tool is over material";
  }
}

TEST_F(OverlapTest, OverlapInsideIsExactlyOneAndOutsideExactlyZero) {
  const Tool tool = make_tool(SceneTool{});
  for (int i = 0; i < 100; ++i) {
    const Pose pose = at(1e-4 * i, -7e-5 * i, 0.1, 0.1 * i);
    const LatticeOutline inside = outline_on_lattice(tool, pose, sheets_[0]->transform, kTop_m);
    EXPECT_EQ(overlap_at(inside), 1);
    // In its own hole the overlap is exactly zero.
    EXPECT_EQ(overlap_at(inside, std::span(&inside, 1)), 0);
    EXPECT_EQ(outline_outside(tool, inside, std::span(&inside, 1)), 0);
    EXPECT_EQ(outline_outside(tool, inside, {}), 1);
  }
  const PlanarTransform& transform = sheets_[0]->transform;
  EXPECT_EQ(overlap_at(outline_on_lattice(tool, at(0.024, 0, 0.1), transform, kTop_m)), 0);
  EXPECT_EQ(outline_outside(tool, LatticeOutline{}, {}), 1);
  EXPECT_EQ(outline_on_lattice(tool, at(1e9, 0, 0.1), transform, kTop_m).size, 0);
  EXPECT_EQ(outline_on_lattice(tool, at(NAN, 0, 0.1), transform, kTop_m).size, 0);
}

TEST_F(OverlapTest, OverlapOfAToolThatIsNotConvexIsTheSumOverItsParts) {
  // The tool consists of two triangles; the overlap of each is found by integration.
  std::mt19937_64 random(7);
  model_.tool = make_tool(arrow());
  ASSERT_EQ(model_.tool.sides, 4);
  ASSERT_EQ(model_.tool.pieces, 2);
  const int low_x = 60 * 256, low_y = 40 * 256, side = 40 * 256;
  const LongPolygon square = {
      {low_x, low_y}, {low_x + side, low_y}, {low_x + side, low_y + side}, {low_x, low_y + side}};
  const auto halves = [](const LatticeOutline& o) {
    const LongPolygon p = polygon(o);
    return std::array<LongPolygon, 2>{LongPolygon{p[0], p[1], p[2]}, LongPolygon{p[0], p[2], p[3]}};
  };
  int partial = 0;
  for (int i = 0; i < 1000; ++i) {
    const auto place = [&](double reach_m) {
      return outline_on_lattice(model_.tool,
                                at(uniform(random, -reach_m, reach_m),
                                   uniform(random, -reach_m, reach_m), 0.1, uniform(random, 0, 7)),
                                sheets_[0]->transform, kTop_m);
    };
    const bool at_the_rim = i % 2 == 0;
    const LatticeOutline outline = place(at_the_rim ? 0.024 : 0.004), hole = place(0.004);
    long double expected = 0;
    for (const LongPolygon& half : halves(outline)) {
      expected += intersection_area({half, square});
      if (at_the_rim) continue;
      for (const LongPolygon& gone : halves(hole))
        expected -= intersection_area({half, gone});
    }
    const double got =
        overlap_at(outline, at_the_rim ? std::span<const LatticeOutline>() : std::span(&hole, 1));
    ASSERT_NEAR(got, static_cast<double>(expected / area(outline)), 3e-9) << i;
    partial += got > 0 && got < 1;
    if (at_the_rim) continue;
    ASSERT_NEAR(outline_outside(model_.tool, outline, std::span(&hole, 1)), got, 3e-9) << i;
  }
  EXPECT_GT(partial, 300);
}

// The contract of runtime/haptics/tool.h.

ShaftSection down_to(double inserted_m, double x_m = 0, double y_m = 0) {
  ShaftSection place;
  place.at_m = {x_m, y_m, 0.12};
  place.inserted_m = inserted_m;
  return place;
}

ShaftTissue sticky() {
  ShaftTissue tissue;
  tissue.dry_friction_N = 2;
  return tissue;
}

TEST(Shaft, DryFrictionRisesToItsValueAndReversesWithTheMotion) {
  const ShaftTissue tissue = sticky();
  ShaftState state;
  enter_hole(down_to(0.01), state);
  EXPECT_NEAR(shaft_force(tissue, down_to(0.01 + tissue.presliding_m / 2), kTick_s, state).z(), 1,
              1e-12);
  EXPECT_NEAR(shaft_force(tissue, down_to(0.02), kTick_s, state).z(), 2, 1e-12);
  EXPECT_NEAR(shaft_force(tissue, down_to(0.02), kTick_s, state).z(), 2, 1e-12) << "at rest";
  EXPECT_NEAR(shaft_force(tissue, down_to(0.02 - tissue.presliding_m), kTick_s, state).z(), 0,
              1e-12);
  EXPECT_NEAR(shaft_force(tissue, down_to(0.015), kTick_s, state).z(), -2, 1e-12);
}

TEST(Shaft, ViscousFrictionIsTheSpeedTimesTheCoefficientAlongATiltedAxis) {
  ShaftTissue tissue;
  tissue.viscous_friction_N_s_per_m = 10;
  ShaftState state;
  ShaftSection place = down_to(0.01);
  place.axis = Eigen::Vector3d(0.6, 0, 0.8);
  enter_hole(place, state);
  place.inserted_m += 1e-4;  // 0.1 m/s
  EXPECT_LT((shaft_force(tissue, place, kTick_s, state) - Eigen::Vector3d(0.6, 0, 0.8)).norm(),
            1e-12);
}

TEST(Shaft, FrictionIsBoundedAndDissipatesOverAClosedMotion) {
  const ShaftTissue tissue = sticky();
  std::mt19937_64 random(1);
  for (int trial = 0; trial < 200; ++trial) {
    ShaftState state;
    enter_hole(down_to(0.02), state);
    double inserted_m = 0.02, taken_J = 0;
    const auto go = [&](double to_m) {
      const double before_N = tissue.dry_friction_N * state.spring_m / tissue.presliding_m;
      const double force_N = shaft_force(tissue, down_to(to_m), kTick_s, state).z();
      ASSERT_LE(std::abs(force_N), tissue.dry_friction_N * (1 + 1e-12));
      taken_J += (before_N + force_N) / 2 * (to_m - inserted_m);
      inserted_m = to_m;
    };
    // Steps below the spring's length, so that the trapezoidal sum is the work.
    for (int i = 0; i < 500; ++i) {
      const double u = static_cast<double>(random() >> 11) * 0x1p-53;
      go(inserted_m + (u - 0.5) * tissue.presliding_m);
    }
    while (std::abs(inserted_m - 0.02) > 1e-5)
      go(inserted_m + (inserted_m < 0.02 ? 1e-5 : -1e-5));
    go(0.02);
    ASSERT_GE(taken_J, -1e-9);
  }
}

}  // namespace
}  // namespace trocar::runtime
