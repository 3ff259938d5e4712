// SPDX-License-Identifier: Apache-2.0
// The laws of runtime/contact/puncture.h, one test each, and the overlap it rests on
// against areas found another way.
#include <gtest/gtest.h>

#include <random>
#include <set>

#include "formats/mesh_validity.h"
#include "runtime/contact/overlap.h"
#include "runtime/contact/puncture.h"
#include "runtime/contact/tissue_choice.h"
#include "runtime/remesh/cut.h"
#include "tests/sheet_fixture.h"

namespace trocar::runtime {
namespace {

using Polygon = std::vector<Eigen::Matrix<long double, 2, 1>>;

Polygon polygon(const LatticeOutline& outline) {
  Polygon result;
  for (int i = 0; i < outline.size; ++i) {
    result.emplace_back(outline.points[i].x, outline.points[i].y);
  }
  return result;
}

/// Area of the intersection of convex polygons, not by clipping: its width is integrated over y
/// between all heights where it can have a kink.
long double intersection_area(const std::vector<Polygon>& convex) {
  std::set<long double> kinks;
  const auto crossings = [&](const Polygon& p, const Polygon& q) {
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
    for (const Polygon& p : convex) {
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
    // Linear within, so the middle's width is exact.
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

long double area(const LatticeOutline& outline) {
  return static_cast<long double>(doubled_area(to_ring(outline))) / 2;
}

Pose at(double x_m, double y_m, double z_m, double yaw_rad = 0) {
  Pose pose;
  pose.p_m = {x_m, y_m, z_m};
  pose.q = Eigen::Quaterniond(Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()));
  return pose;
}

/// In [0, 1), the same on every standard library.
double uniform(std::mt19937_64& random) {
  return static_cast<double>(random() >> 11) * 0x1p-53;
}
double uniform(std::mt19937_64& random, double low, double high) {
  return low + (high - low) * uniform(random);
}

constexpr double kTop_m = 0.12, kTick_s = 1e-3;

/// One or more square sheets of 40 mm around the z axis, and a hexagon of 3 mm.
class Contact : public testing::Test {
 protected:
  void place(const std::vector<double>& heights_m) {
    scene_ = test::descent_scene(heights_m, 0.2, 0.1, 0.015);
    auto placed = place_slices(scene_, test::square_asset(static_cast<int>(heights_m.size())), "a");
    ASSERT_TRUE(placed) << placed.error().message;
    owned_ = std::move(*placed);
    sheets_.clear();
    for (const auto& sheet : owned_)
      sheets_.push_back(sheet.get());
    model_.tool = make_tool(scene_.tool);
    model_.dt_s = kTick_s;
    state_ = ContactState{};
  }
  void SetUp() override { place({kTop_m}); }

  ContactOutput tick(const Pose& pose) {
    ContactOutput output;
    update_contact(model_, sheets_, response_, pose, state_, output);
    return output;
  }
  /// Makes all sheets of it.
  void set_tissue(const Tissue& tissue) {
    for (const Sheet*& sheet : sheets_) {
      auto changed = std::make_unique<Sheet>(*sheet);
      changed->tissue = tissue;
      owned_.push_back(std::move(changed));
      sheet = owned_.back().get();
    }
  }
  double overlap_at(const LatticeOutline& outline, std::span<const LatticeOutline> holes = {}) {
    return overlap(*sheets_[0], model_.tool, outline, holes).fraction;
  }
  /// Cuts and puts the mesh with the hole in use.
  void publish(const CutRequest& request) {
    const Sheet& before = *sheets_[request.sheet];
    auto result = cut(to_slice_mesh(before.mesh), to_ring(request.outline));
    ASSERT_TRUE(result) << result.error().message;
    owned_.push_back(with_mesh(before, result->mesh));
    sheets_[request.sheet] = owned_.back().get();
  }

  Scene scene_;
  ContactModel model_;
  ContactState state_;
  SheetResponse response_;
  std::vector<std::unique_ptr<const Sheet>> owned_;
  std::vector<const Sheet*> sheets_;
};

// --- overlap -------------------------------------------------------------------------------

TEST_F(Contact, OverlapIsTheSharedArea) {
  // The sheet is a square, so tool and square intersected give the area at once; the sheet sums
  // it over triangles.
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

TEST_F(Contact, PendingHolesAreTakenOffOnce) {
  // Against inclusion and exclusion over up to three holes that overlap one another.
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
      std::vector<Polygon> shared = {polygon(outlines[0])};
      for (std::size_t h = 0; h < holes; ++h) {
        if (((subset >> h) & 1) != 0) shared.push_back(polygon(outlines[h + 1]));
      }
      expected += (shared.size() % 2 == 1 ? 1 : -1) * intersection_area(shared);
    }
    expected /= area(outlines[0]);
    const double got = overlap_at(outlines[0], std::span(outlines).subspan(1, holes));
    ASSERT_NEAR(got, static_cast<double>(expected), 3e-9) << i;
  }
}

TEST_F(Contact, OverlapInsideIsExactlyOneAndOutsideExactlyZero) {
  const Tool tool = make_tool(SceneTool{});
  for (int i = 0; i < 100; ++i) {
    const Pose pose = at(1e-4 * i, -7e-5 * i, 0.1, 0.1 * i);
    const LatticeOutline inside = outline_on_lattice(tool, pose, sheets_[0]->transform, kTop_m);
    EXPECT_EQ(overlap_at(inside), 1);
    // In its own hole there is nothing, exactly.
    EXPECT_EQ(overlap_at(inside, std::span(&inside, 1)), 0);
  }
  const PlanarTransform& transform = sheets_[0]->transform;
  EXPECT_EQ(overlap_at(outline_on_lattice(tool, at(0.024, 0, 0.1), transform, kTop_m)), 0);
  EXPECT_EQ(outline_on_lattice(tool, at(1e9, 0, 0.1), transform, kTop_m).size, 0);
  EXPECT_EQ(outline_on_lattice(tool, at(NAN, 0, 0.1), transform, kTop_m).size, 0);
}

// An arrow head: 4 corners, one of them re-entrant.
SceneTool arrow() {
  SceneTool shape;
  shape.outline_m = {{0.004, 0}, {-0.003, 0.003}, {-0.001, 0}, {-0.003, -0.003}};
  return shape;
}

TEST_F(Contact, OverlapOfAToolThatIsNotConvexIsTheSumOverItsParts) {
  // The tool's two halves are triangles: each one's overlap is found by integration.
  std::mt19937_64 random(7);
  model_.tool = make_tool(arrow());
  ASSERT_EQ(model_.tool.sides, 4);
  ASSERT_EQ(model_.tool.pieces, 2);
  const int low_x = 60 * 256, low_y = 40 * 256, side = 40 * 256;
  const Polygon square = {
      {low_x, low_y}, {low_x + side, low_y}, {low_x + side, low_y + side}, {low_x, low_y + side}};
  const auto halves = [](const LatticeOutline& o) {
    const Polygon p = polygon(o);
    return std::array<Polygon, 2>{Polygon{p[0], p[1], p[2]}, Polygon{p[0], p[2], p[3]}};
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
    for (const Polygon& half : halves(outline)) {
      expected += intersection_area({half, square});
      if (at_the_rim) continue;
      for (const Polygon& gone : halves(hole))
        expected -= intersection_area({half, gone});
    }
    const double got =
        overlap_at(outline, at_the_rim ? std::span<const LatticeOutline>() : std::span(&hole, 1));
    ASSERT_NEAR(got, static_cast<double>(expected / area(outline)), 3e-9) << i;
    partial += got > 0 && got < 1;
  }
  EXPECT_GT(partial, 300);
}

TEST_F(Contact, TheOverlapsCentroidIsWhereTheAreaIs) {
  // Over the edge x = 20 mm: the part that is in is symmetric about y = 0, and its moment is that
  // of a trapezium.
  SceneTool shape;
  shape.outline_m = {{-0.004, -0.002}, {0.004, -0.002}, {0.004, 0.002}, {-0.004, 0.002}};
  model_.tool = make_tool(shape);
  const LatticeOutline outline =
      outline_on_lattice(model_.tool, at(0.021, 0, 0.1), sheets_[0]->transform, kTop_m);
  const Overlap part = overlap(*sheets_[0], model_.tool, outline, {});
  EXPECT_NEAR(part.fraction, 3.0 / 8, 1e-9);
  const Eigen::Vector2d centre_m = sheets_[0]->transform.to_scene(part.centroid_steps);
  EXPECT_LT((centre_m - Eigen::Vector2d(0.0185, 0)).norm(), 1e-9);
  // All material, and none: the tool's own middle.
  for (const double x_m : {0.0, 0.03}) {
    const Overlap whole = overlap(
        *sheets_[0], model_.tool,
        outline_on_lattice(model_.tool, at(x_m, 0, 0.1), sheets_[0]->transform, kTop_m), {});
    EXPECT_LT(
        (sheets_[0]->transform.to_scene(whole.centroid_steps) - Eigen::Vector2d(x_m, 0)).norm(),
        1e-9);
  }
}

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
    if (smallest_clearance_m(tool) < kLeastClearance * transform.lattice.step_m()) {
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

TEST(ToolOutline, IsThePrismsSectionWithTheSheet) {
  // Against the prism itself: the points of the section, measured from the axis across it, are the
  // cross-section's corners.
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
  SceneTool comb;  // 15 teeth: more parts than there is room for
  for (int k = 0; k < 15; ++k) {
    comb.outline_m.push_back({0.001 * k, -0.002});
    comb.outline_m.push_back({0.001 * k + 0.0005, 0});
  }
  comb.outline_m.push_back({0.02, 0.004});
  comb.outline_m.push_back({-0.002, 0.004});
  EXPECT_EQ(make_tool(comb).pieces, 0);
}

TEST(ToolOutline, TransformsThereAndBack) {
  PlanarTransform transform;
  transform.at_m = {0.01, -0.02};
  transform.anchor_mm = {80, 72};
  transform.cosine = std::cos(0.7);
  transform.sine = std::sin(0.7);
  const Eigen::Vector2d p(0.013, 0.004);
  EXPECT_LT((transform.to_scene(transform.to_lattice(p)) - p).norm(), 1e-15);
  EXPECT_LT((transform.to_lattice(transform.at_m) - transform.anchor_mm * 256).norm(), 1e-9);
  // u -> x turned by +0.7: one mm along u.
  const Eigen::Vector2d u = transform.to_scene({256 * 81, 256 * 72}) - transform.at_m;
  EXPECT_LT((u - Eigen::Vector2d(std::cos(0.7), std::sin(0.7)) * 1e-3).norm(), 1e-15);
}

// --- placing -------------------------------------------------------------------------------

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

TEST(PlaceSlices, SortsTheTopmostFirstAndKnowsTheCentroid) {
  Scene scene = test::descent_scene({0.12, 0.19, 0.14}, 0.2, 0.1, 0.015);
  scene.placement.anchor_mm.reset();
  const auto placed = place_slices(scene, test::square_asset(3), "a");
  ASSERT_TRUE(placed);
  EXPECT_EQ((*placed)[0]->z_m, 0.19);
  EXPECT_EQ((*placed)[0]->slice_index, 1);
  EXPECT_EQ((*placed)[2]->z_m, 0.12);
  EXPECT_LT(((*placed)[0]->transform.anchor_mm - Eigen::Vector2d(80, 60)).norm(), 1e-9);
}

// --- laws ----------------------------------------------------------------------------------

TEST_F(Contact, Law1MetFromAboveWithMaterialUnderTheTool) {
  EXPECT_EQ(tick(at(0, 0, 0.125)).phase, ContactPhase::kFree);
  EXPECT_EQ(tick(at(0, 0, kTop_m)).phase, ContactPhase::kFree) << "at the height is not below";
  EXPECT_EQ(tick(at(0, 0, kTop_m - 1e-4)).phase, ContactPhase::kContact);
}

TEST_F(Contact, Law1BesideTheMaterialThereIsNoForceUntilAboveAgain) {
  tick(at(0.024, 0, 0.125));
  for (const double x_m : {0.024, 0.01, 0.0}) {  // then under the sheet
    const ContactOutput output = tick(at(x_m, 0, 0.115));
    EXPECT_EQ(output.phase, ContactPhase::kBeside);
    EXPECT_EQ(output.force_N, 0);
    EXPECT_EQ(output.penetration_m, 0);
  }
  tick(at(0, 0, 0.121));
  EXPECT_EQ(tick(at(0, 0, 0.119)).phase, ContactPhase::kContact);
}

TEST_F(Contact, Law1ASessionThatBeginsBelowFeelsNothing) {
  EXPECT_EQ(tick(at(0, 0, 0.115)).phase, ContactPhase::kBeside);
  EXPECT_EQ(tick(at(0, 0, 0.118)).force_N, 0);
}

TEST_F(Contact, Law2HookesLawTimesOverlap) {
  tick(at(0, 0, 0.125));
  for (const double dx_m : {1e-6, 1e-3, 5e-3, 6.9e-3, 2e-3}) {
    const ContactOutput output = tick(at(0, 0, kTop_m - dx_m));
    EXPECT_NEAR(output.force_N, 5000 * dx_m, 1e-9);
    EXPECT_NEAR(output.penetration_m, dx_m, 1e-15);
    EXPECT_EQ(output.active_sheet, 0);
  }
  // Half over the edge at x = 20 mm (a hexagon is symmetric): half the force, within rounding of
  // its corners to the lattice.
  EXPECT_NEAR(tick(at(0.02, 0, kTop_m - 4e-3)).force_N, 0.5 * 5000 * 4e-3, 0.02);
  // Wholly past it: let go, and no force on the way back under the sheet.
  EXPECT_EQ(tick(at(0.024, 0, kTop_m - 4e-3)).force_N, 0);
  EXPECT_EQ(tick(at(0, 0, kTop_m - 4e-3)).force_N, 0);
}

TEST_F(Contact, Law2DampingIsOnTheRateAndNeverPulls) {
  Tissue damped;
  damped.damping_N_s_per_m = 10;
  set_tissue(damped);
  tick(at(0, 0, 0.125));
  EXPECT_NEAR(tick(at(0, 0, kTop_m - 1e-3)).force_N, 5, 1e-9) << "no rate at first contact";
  EXPECT_NEAR(tick(at(0, 0, kTop_m - 1.1e-3)).force_N, 5.5 + 10 * 0.1, 1e-8);
  EXPECT_EQ(tick(at(0, 0, kTop_m - 0.1e-3)).force_N, 0) << "0.5 N - 10 N";
}

TEST_F(Contact, Law3GivesWayInTheVeryTickAndNotAtTheThresholdItself) {
  Tissue round;
  round.stiffness_N_per_m = 4096;
  round.threshold_N = 32;  // dx = 2^-7 m exactly
  set_tissue(round);
  tick(at(0, 0, 0.125));
  const double break_m = 0x1p-7;
  // A sheet at a height that makes dx exact.
  auto exact = std::make_unique<Sheet>(*sheets_[0]);
  exact->z_m = 0.125;
  sheets_[0] = exact.get();
  tick(at(0, 0, 0.13));
  const ContactOutput at_threshold = tick(at(0, 0, 0.125 - break_m));
  EXPECT_EQ(at_threshold.force_N, 32);
  EXPECT_FALSE(at_threshold.gave_way);
  const ContactOutput beyond = tick(at(0, 0, 0.125 - break_m - 1e-9));
  EXPECT_TRUE(beyond.gave_way);
  EXPECT_EQ(beyond.force_N, 0);
  EXPECT_GT(beyond.judged_force_N, 32);
  EXPECT_EQ(beyond.phase, ContactPhase::kPunctured);
  EXPECT_EQ(beyond.cut.sheet, 0);
  EXPECT_EQ(beyond.cut.cut, 1U);
  EXPECT_EQ(beyond.cut.outline,
            outline_on_lattice(model_.tool, at(0, 0, 0.1), exact->transform, 0.125));
  for (const double z_m : {0.11, 0.1, 0.1249, 0.12}) {
    const ContactOutput after = tick(at(0, 0, z_m));
    EXPECT_EQ(after.force_N, 0);
    EXPECT_FALSE(after.gave_way);
    EXPECT_EQ(after.phase, ContactPhase::kPunctured);
  }
}

TEST_F(Contact, Law4TheTopmostBearsAndShields) {
  place({0.120, 0.118, 0.116});
  tick(at(0, 0, 0.125));
  ContactOutput output = tick(at(0, 0, 0.1135));  // below all three, 6.5 mm into the first
  EXPECT_EQ(output.active_sheet, 0);
  EXPECT_NEAR(output.force_N, 5000 * 6.5e-3, 1e-9);
  output = tick(at(0, 0, 0.1125));  // 7.5 mm: the first gives way
  EXPECT_TRUE(output.gave_way);
  EXPECT_EQ(output.active_sheet, 0);
  EXPECT_EQ(output.force_N, 0) << "the second is shielded in this tick";
  output = tick(at(0, 0, 0.1125));  // 5.5 mm into the second
  EXPECT_EQ(output.active_sheet, 1);
  EXPECT_NEAR(output.force_N, 5000 * 5.5e-3, 1e-9);
  output = tick(at(0, 0, 0.105));  // 13 mm: the second
  EXPECT_TRUE(output.gave_way);
  output = tick(at(0, 0, 0.105));  // 11 mm into the third, at once too much
  EXPECT_TRUE(output.gave_way);
  EXPECT_EQ(output.active_sheet, 2);
  EXPECT_EQ(output.force_N, 0);
  EXPECT_EQ(tick(at(0, 0, 0.105)).force_N, 0);
}

TEST_F(Contact, Law4WithdrawalFromAShieldedSheetLeavesItWhole) {
  place({0.120, 0.118});
  tick(at(0, 0, 0.125));
  tick(at(0, 0, 0.114));
  EXPECT_EQ(tick(at(0, 0, 0.119)).active_sheet, 0);
  EXPECT_EQ(tick(at(0, 0, 0.121)).phase, ContactPhase::kFree);
  EXPECT_EQ(state_.tracks[1].cuts_requested, 0U);
}

TEST_F(Contact, Law5AHoleIsOpenBeforeAndAfterItsMeshIsThere) {
  tick(at(0, 0, 0.125));
  const ContactOutput puncture = tick(at(0, 0, 0.112));
  ASSERT_TRUE(puncture.gave_way);
  for (const bool published : {false, true}) {
    if (published) publish(puncture.cut);
    EXPECT_EQ(tick(at(0, 0, 0.121)).phase, ContactPhase::kFree);
    EXPECT_EQ(tick(at(0, 0, 0.115)).phase, ContactPhase::kBeside) << published;
    EXPECT_EQ(tick(at(0, 0, 0.111)).force_N, 0);
    // A few micrometres off it is still its own hole.
    tick(at(4e-6, -3e-6, 0.121));
    EXPECT_EQ(tick(at(4e-6, -3e-6, 0.115)).phase, ContactPhase::kBeside) << published;
    // Half a tool further there is half the material.
    tick(at(0.003, 0, 0.121));
    const double force_N = tick(at(0.003, 0, 0.119)).force_N;
    EXPECT_GT(force_N, 0.3 * 5);
    EXPECT_LT(force_N, 0.8 * 5);
    // And away from it the sheet is whole.
    tick(at(0.01, 0, 0.121));
    EXPECT_NEAR(tick(at(0.01, 0, 0.119)).force_N, 5, 1e-9);
  }
  EXPECT_EQ(state_.tracks[0].pending_count, 0) << "the mesh has the hole now";
}

TEST_F(Contact, Law5PendingHolesArePublishedInOrderAndTooManyAreABacklog) {
  std::vector<CutRequest> requests;
  const auto puncture = [&](double x_m) {
    tick(at(x_m, 0, 0.125));
    ContactOutput output = tick(at(x_m, 0, 0.112));
    if (output.gave_way) requests.push_back(output.cut);
    return output;
  };
  for (int i = 0; i < kMaxPendingHoles; ++i)
    EXPECT_TRUE(puncture(-0.015 + 0.007 * i).gave_way);
  const ContactOutput full = puncture(0.015);
  EXPECT_TRUE(full.backlog);
  EXPECT_FALSE(full.gave_way);
  EXPECT_EQ(full.force_N, 0);
  publish(requests[0]);
  publish(requests[1]);
  tick(at(0, 0, 0.125));
  EXPECT_EQ(state_.tracks[0].pending_count, 2);
  EXPECT_EQ(state_.tracks[0].pending[0], requests[2].outline);
  for (int i = 0; i < kMaxPendingHoles; ++i) {
    tick(at(-0.015 + 0.007 * i, 0, 0.125));
    EXPECT_EQ(tick(at(-0.015 + 0.007 * i, 0, 0.115)).phase, ContactPhase::kBeside) << i;
  }
  EXPECT_TRUE(puncture(0.015).gave_way) << "there is room again";
  EXPECT_EQ(requests.back().cut, 5U);
}

TEST_F(Contact, Law2TheForceActsInTheMiddleOfTheOverlap) {
  tick(at(0, 0, 0.125));
  ContactOutput output = tick(at(0.001, 0.002, kTop_m - 4e-3));
  EXPECT_LT((output.wrench_device - (Wrench() << 0, 0, 20, 0, 0, 0).finished()).norm(), 1e-4)
      << "the middle of the tool is the plate's origin, but for the corners' rounding";
  // Half over the edge: half a hexagon is a rectangle (to r / 2) and a triangle (from there to r).
  output = tick(at(0.02, 0, kTop_m - 4e-3));
  const double r = 0.003;
  const double rectangle = 2, triangle = 1;  // areas
  const double centroid_m =
      -(rectangle * r / 4 + triangle * (r / 2 + r / 6)) / (rectangle + triangle);
  EXPECT_NEAR(output.wrench_device[4] / -output.wrench_device[2], centroid_m, 1e-5);
  EXPECT_NEAR(output.wrench_device[3], 0, 1e-4);
}

TEST_F(Contact, Law2ByNetworkTheResponseIsTheForceOncePublished) {
  model_.law = ForceLawKind::kNetwork;
  EXPECT_EQ(tick(at(0, 0, 0.16)).ahead.sheet, -1) << "too far above";
  const ContactOutput near = tick(at(0.001, 0, 0.125));
  ASSERT_EQ(near.ahead.sheet, 0);
  EXPECT_EQ(near.ahead.outline,
            outline_on_lattice(model_.tool, at(0.001, 0, 0.125), sheets_[0]->transform, kTop_m));
  // Without one, Hooke's law.
  EXPECT_NEAR(tick(at(0, 0, kTop_m - 1e-3)).force_N, 5, 1e-9);
  // With one it is approached, never passed, and reached.
  response_ = {0, 3000, {1e-3, 0}};
  double last_N = 5;
  for (int i = 0; i < 60; ++i) {
    const ContactOutput output = tick(at(0, 0, kTop_m - 1e-3));
    EXPECT_LT(output.force_N, last_N);
    EXPECT_LT(last_N - output.force_N, 0.5) << "no step";
    EXPECT_GT(output.force_N, 3);
    last_N = output.force_N;
  }
  const ContactOutput reached = tick(at(0, 0, kTop_m - 1e-3));
  EXPECT_NEAR(reached.force_N, 3, 1e-4);
  EXPECT_NEAR(reached.wrench_device[4], -3e-3, 1e-6) << "about y: x = 1 mm times 3 N";
  // There before the contact: from its first tick on.
  tick(at(0, 0, 0.125));
  EXPECT_NEAR(tick(at(0, 0, kTop_m - 1e-3)).force_N, 3, 1e-12);
  // Another sheet's does not count.
  response_.sheet = 1;
  tick(at(0, 0, 0.125));
  EXPECT_NEAR(tick(at(0, 0, kTop_m - 1e-3)).force_N, 5, 1e-9);
  // Past the sheet that gave way it is the next one's that is wanted.
  place({0.12, 0.11});
  tick(at(0, 0, 0.125));
  EXPECT_EQ(tick(at(0, 0, 0.1125)).ahead.sheet, 1);
}

TEST_F(Contact, Law6DownAlongATiltedAxisTheOutlineKeepsItsPlace) {
  SceneTool shape;
  shape.tilt_deg = 40;
  shape.tilt_azimuth_deg = 25;
  model_.tool = make_tool(shape);
  const Eigen::Vector3d axis = model_.tool.axis_plate;
  EXPECT_NEAR(axis.z(), std::cos(40 * std::numbers::pi / 180), 1e-15);
  const auto along = [&](double above_m) {
    Pose pose;
    pose.p_m = Eigen::Vector3d(0, 0, kTop_m) + above_m / axis.z() * axis;
    return pose;
  };
  tick(along(0.005));
  EXPECT_NEAR(tick(along(-0.003)).force_N, 15, 1e-9);
  const ContactOutput puncture = tick(along(-0.0071));
  ASSERT_TRUE(puncture.gave_way);
  const LatticeOutline above =
      outline_on_lattice(model_.tool, along(0.005), sheets_[0]->transform, kTop_m);
  ASSERT_EQ(puncture.cut.outline.size, above.size);
  for (int k = 0; k < above.size; ++k) {  // but for rounding that falls the other way
    EXPECT_LE(std::abs(puncture.cut.outline.points[k].x - above.points[k].x), 1);
    EXPECT_LE(std::abs(puncture.cut.outline.points[k].y - above.points[k].y), 1);
  }
  // Sheared along the tilt, as wide as before across it.
  const double stretch =
      static_cast<double>(area(puncture.cut.outline)) /
      static_cast<double>(area(outline_on_lattice(make_tool(SceneTool{}), at(0, 0, 0.1),
                                                  sheets_[0]->transform, kTop_m)));
  EXPECT_NEAR(stretch, 1 / axis.z(), 1e-3);
}

TEST_F(Contact, BeyondTheLargestTiltTheToolIsNotUpright) {
  SceneTool shape;
  shape.tilt_deg = 45;
  model_.tool = make_tool(shape);
  EXPECT_FALSE(tick(at(0, 0, 0.125)).not_upright);
  Pose tilted = at(0, 0, 0.125);
  tilted.q = Eigen::AngleAxisd(0.01, Eigen::Vector3d::UnitY());
  EXPECT_TRUE(tick(tilted).not_upright);
  tilted.q = Eigen::AngleAxisd(-0.01, Eigen::Vector3d::UnitY());
  EXPECT_FALSE(tick(tilted).not_upright);
}

TEST_F(Contact, EachSheetHasItsTissueAndHoldsTheShaft) {
  place({0.12, 0.11});
  Tissue soft;
  soft.stiffness_N_per_m = 1000;
  soft.threshold_N = 2;
  soft.shaft.dry_friction_N = 3;
  soft.shaft.rim_stiffness_N_per_m = 2000;
  set_tissue(soft);
  auto hard = std::make_unique<Sheet>(*sheets_[1]);
  hard->tissue = Tissue{};
  sheets_[1] = hard.get();
  tick(at(0, 0, 0.125));
  EXPECT_NEAR(tick(at(0, 0, 0.1185)).force_N, 1.5, 1e-9);
  EXPECT_TRUE(tick(at(0, 0, 0.1179)).gave_way);
  ContactOutput output = tick(at(0, 0, 0.1129));  // 5 mm further: the friction is fully there
  EXPECT_EQ(output.force_N, 0);
  EXPECT_NEAR(output.wrench_device[2], 3, 1e-12);
  output = tick(at(0, 0, 0.108));  // and adds to what the next sheet bears
  EXPECT_NEAR(output.force_N, 10, 1e-9);
  EXPECT_NEAR(output.wrench_device[2], 13, 1e-9);
  // Pushed aside by 1 mm: the rim pushes back in the sheet's plane, with its moment.
  output = tick(at(0.001, 0, 0.108));
  EXPECT_NEAR(output.wrench_device[0], -2, 1e-9);
  EXPECT_NEAR(output.wrench_device[4], 0.012 * -2, 1e-4);
  // Drawn back out it is gone.
  EXPECT_LT(tick(at(0, 0, 0.119)).wrench_device[2], 0);
  EXPECT_EQ(tick(at(0, 0, 0.121)).wrench_device, Wrench::Zero());
  EXPECT_EQ(tick(at(0, 0, 0.119)).wrench_device, Wrench::Zero()) << "back through its hole";
}

TEST(TissueChoice, ByNameThenByLabelOrHuThenTheScenes) {
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
  const auto threshold = [&] { return tissue_of(scene, wanted, asset, slice).threshold_N; };
  EXPECT_EQ(threshold(), 1);
  slice.measures["mean_hu"] = 500;
  EXPECT_EQ(threshold(), 4);
  slice.measures["mean_hu"] = 501;
  EXPECT_EQ(threshold(), 1);
  asset.parameters["labels"] = {5, 22};
  EXPECT_EQ(threshold(), 3);
  wanted.tissue = "named";
  EXPECT_EQ(threshold(), 2);
  wanted.tissue.reset();
  asset.parameters["labels"] = "22";  // not what the pipeline writes
  slice.measures["mean_hu"] = "400";
  EXPECT_EQ(threshold(), 1);
}

TEST_F(Contact, TheToolTurnsAndTiltsWithThePlate) {
  // A tip held out sideways: turning the plate moves it off the sheet.
  model_.tool.tip_plate_m = {0.03, 0, 0};
  for (Eigen::Vector3d& corner : model_.tool.corner_plate_m)
    corner.x() += 0.03;
  tick(at(-0.03, 0, 0.125));
  EXPECT_EQ(tick(at(-0.03, 0, 0.119)).phase, ContactPhase::kContact);
  tick(at(-0.03, 0, 0.125));
  EXPECT_EQ(tick(at(-0.03, 0, 0.119, std::numbers::pi)).phase, ContactPhase::kBeside);
}

}  // namespace
}  // namespace trocar::runtime
