// SPDX-License-Identifier: Apache-2.0
// The laws of runtime/contact/puncture.h, one test each, and the overlap it rests on
// against areas found another way.
#include <gtest/gtest.h>

#include <random>
#include <set>

#include "formats/mesh_validity.h"
#include "runtime/contact/puncture.h"
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
    model_.tissue = scene_.tissue;
    model_.tool = make_tool(scene_.tool);
    model_.dt_s = kTick_s;
    state_ = ContactState{};
  }
  void SetUp() override { place({kTop_m}); }

  ContactOutput tick(const Pose& pose) {
    ContactOutput output;
    update_contact(model_, sheets_, pose, state_, output);
    return output;
  }
  /// Cuts and puts the mesh with the hole in use.
  void publish(const CutRequest& request) {
    const Sheet& before = *sheets_[request.sheet];
    auto result = cut(before.mesh, to_ring(request.outline));
    ASSERT_TRUE(result) << result.error().message;
    owned_.push_back(with_mesh(before, std::move(result->mesh)));
    sheets_[request.sheet] = owned_.back().get();
  }

  Scene scene_;
  ContactModel model_;
  ContactState state_;
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
        outline_on_lattice(make_tool(shape), pose, sheets_[0]->transform);
    ASSERT_EQ(outline.size, shape.sides);
    const long double expected =
        intersection_area({polygon(outline), polygon(square)}) / area(outline);
    const double got = overlap_fraction(*sheets_[0], outline, {});
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
    for (LatticeOutline& outline : outlines) {
      SceneTool shape;
      shape.sides = 3 + static_cast<int>(random() % 8);
      outline = outline_on_lattice(make_tool(shape),
                                   at(uniform(random, -0.004, 0.004),
                                      uniform(random, -0.004, 0.004), 0.1, uniform(random, 0, 7)),
                                   sheets_[0]->transform);
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
    const double got =
        overlap_fraction(*sheets_[0], outlines[0], std::span(outlines).subspan(1, holes));
    ASSERT_NEAR(got, static_cast<double>(expected), 3e-9) << i;
  }
}

TEST_F(Contact, OverlapInsideIsExactlyOneAndOutsideExactlyZero) {
  const Tool tool = make_tool(SceneTool{});
  for (int i = 0; i < 100; ++i) {
    const Pose pose = at(1e-4 * i, -7e-5 * i, 0.1, 0.1 * i);
    const LatticeOutline inside = outline_on_lattice(tool, pose, sheets_[0]->transform);
    EXPECT_EQ(overlap_fraction(*sheets_[0], inside, {}), 1);
    // In its own hole there is nothing, exactly.
    EXPECT_EQ(overlap_fraction(*sheets_[0], inside, std::span(&inside, 1)), 0);
  }
  const LatticeOutline outside = outline_on_lattice(tool, at(0.024, 0, 0.1), sheets_[0]->transform);
  EXPECT_EQ(overlap_fraction(*sheets_[0], outside, {}), 0);
  EXPECT_EQ(outline_on_lattice(tool, at(1e9, 0, 0.1), sheets_[0]->transform).size, 0);
  EXPECT_EQ(outline_on_lattice(tool, at(NAN, 0, 0.1), sheets_[0]->transform).size, 0);
}

TEST(ToolOutline, IsStrictlyConvexHoweverCoarseTheLattice) {
  std::mt19937_64 random(3);
  for (int i = 0; i < 5000; ++i) {
    SceneTool shape;
    shape.sides = 3 + static_cast<int>(random() % 30);
    shape.radius_m = uniform(random, 0.0001, 0.003);
    PlanarTransform transform;
    transform.lattice.bits = static_cast<int>(random() % 9);
    const LatticeOutline outline =
        outline_on_lattice(make_tool(shape), at(0, 0, 0, uniform(random, 0, 7)), transform);
    for (int k = 0; k < outline.size; ++k) {
      ASSERT_GT(orient2d(outline.points[k], outline.points[(k + 1) % outline.size],
                         outline.points[(k + 2) % outline.size]),
                0);
    }
  }
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

TEST(TriangleGrid, FindsWhatAScanFinds) {
  std::mt19937_64 random(4);
  const auto coordinate = [&](std::int32_t range) {
    return static_cast<std::int32_t>(random() % (2 * range + 1)) - range;
  };
  for (const bool thin : {false, true}) {
    SliceMesh mesh;  // a heap of triangles; the grid asks for no more
    for (int i = 0; i < 400; ++i) {
      const LatticePoint a{coordinate(10'000), coordinate(10'000)};
      const std::int32_t size = thin ? 10'000 : 300;
      for (const LatticePoint p : {a, LatticePoint{a.x + coordinate(size), a.y + coordinate(size)},
                                   LatticePoint{a.x + coordinate(size), a.y + coordinate(size)}}) {
        mesh.vertices.push_back(p);
      }
      const auto n = static_cast<std::uint32_t>(mesh.vertices.size());
      mesh.triangles.push_back({n - 3, n - 2, n - 1});
    }
    const TriangleGrid grid(mesh);
    for (int i = 0; i < 300; ++i) {
      const LatticePoint p{coordinate(15'000), coordinate(15'000)};
      const LatticeBox box{p, {p.x + coordinate(2000) + 2000, p.y + coordinate(2000) + 2000}};
      std::multiset<std::uint32_t> expected, got;
      for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
        const LatticeBox own = bounding_box(mesh, mesh.triangles[t]);
        if (own.lowest.x <= box.highest.x && box.lowest.x <= own.highest.x &&
            own.lowest.y <= box.highest.y && box.lowest.y <= own.highest.y) {
          expected.insert(t);
        }
      }
      grid.for_each(mesh, box, [&](std::uint32_t t) { got.insert(t); });
      ASSERT_EQ(got, expected);
    }
  }
  TriangleGrid().for_each(SliceMesh{}, {}, [](std::uint32_t) { FAIL(); });
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
  fine_tool.tool.sides = 32;
  fine_tool.tool.radius_m = 1e-4;
  EXPECT_FALSE(place_slices(fine_tool, test::square_asset(2), "a")) << "25 steps for 32 corners";
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
  model_.tissue.damping_N_s_per_m = 10;
  tick(at(0, 0, 0.125));
  EXPECT_NEAR(tick(at(0, 0, kTop_m - 1e-3)).force_N, 5, 1e-9) << "no rate at first contact";
  EXPECT_NEAR(tick(at(0, 0, kTop_m - 1.1e-3)).force_N, 5.5 + 10 * 0.1, 1e-8);
  EXPECT_EQ(tick(at(0, 0, kTop_m - 0.1e-3)).force_N, 0) << "0.5 N - 10 N";
}

TEST_F(Contact, Law3GivesWayInTheVeryTickAndNotAtTheThresholdItself) {
  model_.tissue.stiffness_N_per_m = 4096;
  model_.tissue.threshold_N = 32;  // dx = 2^-7 m exactly
  tick(at(0, 0, 0.125));
  const double break_m = 0x1p-7;
  sheets_[0] = nullptr;  // a sheet at a height that makes dx exact
  auto exact = std::make_unique<Sheet>(*owned_[0]);
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
  EXPECT_EQ(beyond.cut.outline, outline_on_lattice(model_.tool, at(0, 0, 0.1), exact->transform));
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

TEST_F(Contact, TheWrenchIsThatOfTheForceAtTheTip) {
  ContactOutput contact;
  contact.tip_device_m = {0.01, 0.02, 0.1};
  contact.force_N = 10;
  const Wrench wrench = contact_wrench(contact, at(0.004, 0.005, 0.15));
  EXPECT_LT((wrench - (Wrench() << 0, 0, 10, 0.15, -0.06, 0).finished()).norm(), 1e-12);
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
