// SPDX-License-Identifier: Apache-2.0
// The admissible region against brute force: points all over it, and their distance to every boundary
// edge of the sheet.
#include "runtime/haptics/bone/admissible_region.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "formats/mesh/cut.h"
#include "tests/support/body_fixture.h"
#include "tests/support/deformation_fixture.h"
#include "tests/support/random_geometry.h"
#include "tests/support/whole_cut.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;

constexpr double kRounding_m = 1e-8;

/// A square sheet of 40 mm around the origin less these rings (in steps, relative to its middle).
class Place {
 public:
  explicit Place(const std::vector<Ring>& holes = {}) {
    Asset asset = test::square_asset(1);
    SliceMesh& mesh = asset.slices[0].mesh;
    for (Ring ring : holes) {
      for (LatticePoint& p : ring)
        p = {p.x + 80 * 256, p.y + 60 * 256};
      auto made = cut(mesh, ring);
      EXPECT_TRUE(made) << made.error().message;
      mesh = made->mesh;
    }
    asset.slices[0].pslg = boundary_rings(mesh);
    rings_ = asset.slices[0].pslg.rings;
    Scene scene = test::cutting_scene({0.12});
    scene.placement.rotation_deg = 30;
    placed_ = std::make_unique<test::Placed>(scene, asset);
  }
  const Sheet& sheet() const { return *placed_->sheets[0]; }

  /// Whether a point of the slice plane, in mm from the square's middle, is in material.
  Vector2d scene_of(double x_mm, double y_mm) const {
    return sheet().transform.to_scene(Vector2d((80 + x_mm) * 256, (60 + y_mm) * 256));
  }
  bool is_material(const Vector2d& p_m) const {
    const Vector2d p = sheet().transform.to_lattice(p_m);
    return winding(p.x(), p.y(), rings_) != 0;
  }
  /// Distance to the nearest boundary edge.
  double edge_m(const Vector2d& p_m) const {
    const Vector2d p = sheet().transform.to_lattice(p_m);
    Real least = 1e30L;
    for (const Ring& ring : rings_)
      for (std::size_t i = 0; i < ring.size(); ++i)
        least = std::min(least, distance(p.x(), p.y(), ring[i], ring[(i + 1) % ring.size()]));
    return static_cast<double>(least) * sheet().transform.lattice.step_m();
  }

 private:
  std::vector<Ring> rings_;
  std::unique_ptr<test::Placed> placed_;
};

/// Corners, points along the edges, and many within.
std::vector<Vector2d> points_of(const Slot& region, Random& random) {
  std::vector<Vector2d> points;
  const int n = region.corners();
  for (int i = 0; i < n; ++i) {
    const Vector2d &p = region.corner(i), &q = region.corner((i + 1) % n);
    for (int k = 0; k < 10; ++k)
      points.emplace_back(p + 0.1 * k * (q - p));
  }
  for (int k = 0; k < 60; ++k) {
    Vector2d p = Vector2d::Zero();
    double sum = 0;
    for (int i = 0; i < n; ++i) {
      const double weight = -std::log(1 - random.unit());
      p += weight * region.corner(i);
      sum += weight;
    }
    points.emplace_back(p / sum);
  }
  return points;
}

/// Contract 1 and the outer bound of contract 2.
void expect_free(const Place& place, const Slot& region, const Vector2d& at_m, double radius_m,
                 Random& random, const std::string& where) {
  ASSERT_TRUE(region.is_open());
  EXPECT_EQ(region.clearance_m(), 0);
  if (region.corners() == 1) {
    EXPECT_EQ(region.corner(0), at_m) << where;
    return;
  }
  for (const Vector2d& p : points_of(region, random)) {
    ASSERT_FALSE(place.is_material(p)) << where << ": in material";
    ASSERT_GE(place.edge_m(p), radius_m - kRounding_m)
        << where << ": " << (p - at_m).transpose() << " from the axis";
    ASSERT_LE((p - at_m).norm(), kSight_m * (1 + 1e-9)) << where;
  }
}

Ring rectangle(int x0_mm, int y0_mm, int x1_mm, int y1_mm) {
  const auto p = [](int x_mm, int y_mm) { return LatticePoint{x_mm * 256, y_mm * 256}; };
  return {p(x0_mm, y0_mm), p(x1_mm, y0_mm), p(x1_mm, y1_mm), p(x0_mm, y1_mm)};
}

bool has(const Slot& region, const Vector2d& p_m) {
  return region.reach(p_m).distance_m <= kRounding_m;
}

TEST(AdmissibleRegion, NothingIsNearerToItThanTheRadius) {
  Random random(31);
  int regions = 0, points = 0;
  for (int trial = 0; trial < 60; ++trial) {
    std::vector<Ring> holes;
    for (int k = random.between(1, 3); k > 0; --k)
      holes.push_back(star(random, random.point(-2500, 2500), 400, 2600, random.between(4, 14)));
    const Place place(holes);
    for (int k = 0; k < 40; ++k) {
      const Vector2d at_m =
          place.scene_of(30 * (2 * random.unit() - 1), 30 * (2 * random.unit() - 1));
      const double radius_m = 0.3e-3 + 2.7e-3 * random.unit();
      const Slot region = admissible_region(place.sheet(), at_m, radius_m);
      const std::string where = std::to_string(trial) + "/" + std::to_string(k);
      expect_free(place, region, at_m, radius_m, random, where);
      if (HasFatalFailure()) return;
      const bool is_free = !place.is_material(at_m) && place.edge_m(at_m) > radius_m + kRounding_m;
      if (is_free) {
        EXPECT_TRUE(has(region, at_m)) << where << ": an axis that presses on nothing is within";
      }
      ++(region.corners() > 1 ? regions : points);
    }
  }
  EXPECT_GT(regions, 600);
  EXPECT_GT(points, 600);
}

TEST(AdmissibleRegion, AStraightWallCutsItOffAtTheRadius) {
  const Place place;
  constexpr double radius_m = 1e-3;
  for (const double beside_mm : {1.0, 1.5, 3.0, 4.0}) {  // of the square's right edge
    const Vector2d at_m = place.scene_of(20 + beside_mm, 1.3);
    const Slot region = admissible_region(place.sheet(), at_m, radius_m);
    ASSERT_GT(region.corners(), 2);
    EXPECT_TRUE(has(region, at_m));
    EXPECT_TRUE(has(region, place.scene_of(21 + 1e-5, 1.3))) << "up to the wall";
    EXPECT_NEAR(region.reach(place.scene_of(20.5, 1.3)).distance_m, 0.5e-3, 1e-7);
    for (const double aside_mm : {-2.3, 2.3})
      EXPECT_TRUE(has(region, place.scene_of(20 + beside_mm, 1.3 + aside_mm))) << "along it";
    EXPECT_TRUE(has(region, place.scene_of(20 + beside_mm + 2.3, 1.3))) << "away from it";
  }
  const Slot far = admissible_region(place.sheet(), place.scene_of(40, 0), radius_m);
  ASSERT_GT(far.corners(), 2) << "nothing is in sight";
  EXPECT_TRUE(has(far, place.scene_of(43, 0)));
}

TEST(AdmissibleRegion, AnAxisThatPressesIsOutsideByTheOverlap) {
  const Place place;
  for (const double radius_mm : {0.6, 1.5, 3.0}) {
    for (const double overlap_mm : {0.01, 0.1, 0.5}) {
      const Vector2d at_m = place.scene_of(20 + radius_mm - overlap_mm, -3);
      const Slot region = admissible_region(place.sheet(), at_m, radius_mm * 1e-3);
      ASSERT_GT(region.corners(), 2) << radius_mm << ", " << overlap_mm;
      const Slot::Reach reach = region.reach(at_m);
      EXPECT_NEAR(reach.distance_m, overlap_mm * 1e-3, 1e-7);
      const Vector2d into = (place.scene_of(19, -3) - place.scene_of(20, -3)).normalized();
      EXPECT_NEAR(reach.away.dot(into), 1, 1e-6) << "the wall pushes out of the material";
    }
  }
}

TEST(AdmissibleRegion, ACanalIsFreeByWhatItIsWiderThanTheTool) {
  const Place place({rectangle(-2, -15, 2, 15)});  // 4 mm wide
  Random random(32);
  for (const double off_mm : {-0.7, 0.0, 0.4}) {
    const Vector2d at_m = place.scene_of(off_mm, 2);
    const Slot region = admissible_region(place.sheet(), at_m, 1.2e-3);
    expect_free(place, region, at_m, 1.2e-3, random, "canal");
    ASSERT_GT(region.corners(), 2);
    for (const double side : {-1.0, 1.0}) {
      EXPECT_TRUE(has(region, place.scene_of(side * 0.79, 2))) << "up to either wall";
      EXPECT_FALSE(has(region, place.scene_of(side * 0.82, 2)));
    }
    EXPECT_TRUE(has(region, place.scene_of(off_mm, 4))) << "along it";
    // The gap is as wide as the tool, or narrower.
    EXPECT_EQ(admissible_region(place.sheet(), at_m, 2.1e-3).corners(), 1);
    EXPECT_EQ(admissible_region(place.sheet(), at_m, 3e-3).corners(), 1);
  }
}

TEST(AdmissibleRegion, AConcaveCornerCutsItOffOnBothSides) {
  // The material is around a rectangle: its corner at (10, 10) mm is concave for the tool.
  const Place place({rectangle(-10, -10, 10, 10)});
  Random random(33);
  const Vector2d at_m = place.scene_of(8, 7.5);
  const Slot region = admissible_region(place.sheet(), at_m, 1e-3);
  expect_free(place, region, at_m, 1e-3, random, "corner");
  EXPECT_TRUE(has(region, place.scene_of(8.99, 8.99)));
  EXPECT_FALSE(has(region, place.scene_of(9.02, 8)));
  EXPECT_FALSE(has(region, place.scene_of(8, 9.02)));
  // Pressed on both walls: outside by the distance to the corner of what is free.
  const Vector2d pressed_m = place.scene_of(9.3, 9.4);
  const Slot both = admissible_region(place.sheet(), pressed_m, 1e-3);
  EXPECT_NEAR(both.reach(pressed_m).distance_m, std::hypot(0.3, 0.4) * 1e-3, 1e-7);
}

TEST(AdmissibleRegion, AConvexCornerIsTouchedAtTheRadius) {
  const Place place;  // the square's corner at (20, 20) mm
  Random random(34);
  for (const double away_mm : {0.9, 1.5, 2.5}) {
    const Vector2d at_m = place.scene_of(20 + away_mm, 20 + away_mm);
    const Slot region = admissible_region(place.sheet(), at_m, 1e-3);
    expect_free(place, region, at_m, 1e-3, random, "convex corner");
    EXPECT_TRUE(has(region, place.scene_of(20 + 0.708, 20 + 0.708)));
    EXPECT_FALSE(has(region, place.scene_of(20.7, 20.7)));
  }
}

TEST(AdmissibleRegion, InMaterialItIsTheAxisAlone) {
  const Place place({rectangle(-4, -4, 4, 4)});
  for (const Vector2d& at_m : {place.scene_of(10, 10), place.scene_of(4.5, 0),
                               place.scene_of(-19.99, 3), place.scene_of(10, 0.3)}) {
    ASSERT_TRUE(place.is_material(at_m));
    const Slot region = admissible_region(place.sheet(), at_m, 1e-3);
    ASSERT_EQ(region.corners(), 1);
    EXPECT_EQ(region.corner(0), at_m);
    EXPECT_EQ(region.clearance_m(), 0);
  }
}

TEST(AdmissibleRegion, WithinAHoleItsEdgesAreTheWalls) {
  Random random(35);
  for (const int sides : {3, 6, 12, 30}) {
    for (const double hole_mm : {3.0, 4.0, 7.0}) {
      const Place place({test::regular_polygon({0, 0}, 256 * hole_mm, sides)});
      const std::string where = std::to_string(sides) + " sides, " + std::to_string(hole_mm);
      const double inner_mm = hole_mm * std::cos(std::numbers::pi / sides);
      for (const double off_mm : {0.0, 0.25 * (inner_mm - 0.5)}) {
        const Vector2d at_m = place.scene_of(off_mm, 0.3 * off_mm);
        const Slot region = admissible_region(place.sheet(), at_m, 0.5e-3);
        ASSERT_GT(region.corners(), 2) << where;
        expect_free(place, region, at_m, 0.5e-3, random, where);
        EXPECT_TRUE(has(region, at_m)) << where;
      }
      const Slot full = admissible_region(place.sheet(), place.scene_of(0, 0), hole_mm * 1e-3);
      EXPECT_EQ(full.corners(), 1) << where << ": the tool is as large as the hole";
    }
  }
}

TEST(AdmissibleRegion, PlacesOffTheLatticeAreTheAxisAlone) {
  const Place place;
  for (const double far : {1e6, -1e12, std::nan("")}) {
    const Slot region = admissible_region(place.sheet(), {far, 0}, 1e-3);
    EXPECT_EQ(region.corners(), 1);
  }
}

}  // namespace
}  // namespace trocar::runtime
