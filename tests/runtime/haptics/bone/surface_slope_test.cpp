// SPDX-License-Identifier: Apache-2.0
// The slope under a tip on bodies whose surface is known.
#include "runtime/haptics/bone/bone_contact.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <optional>
#include <utility>

#include "tests/support/body_fixture.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;

constexpr double kTop_m = 0.12;

/// Squares of 40 mm, the highest around the device's axis, each moved along x in mm. The z of a slice is that of its
/// middle.
class Body {
 public:
  Body(int slices, double spacing_mm, const std::function<double(int)>& shift_mm,
       double rotation_deg = 0, double half_angle_deg = 30)
      : spacing_m_(spacing_mm * 1e-3) {
    Asset asset = test::spaced_asset(slices, spacing_mm);
    for (int i = 0; i < slices; ++i) {
      AssetSlice& slice = asset.slices[static_cast<std::size_t>(i)];
      const int steps = static_cast<int>(std::lround(256 * shift_mm(slices - 1 - i)));
      for (LatticePoint& p : slice.mesh.vertices)
        p.x += steps;
      for (Ring& ring : slice.pslg.rings)
        for (LatticePoint& p : ring)
          p.x += steps;
    }
    Scene scene = test::body_scene(0, slices - 1, kTop_m);
    scene.tool.kind = half_angle_deg < 90 ? "needle-conical" : "";
    scene.tool.half_angle_deg = half_angle_deg;
    scene.placement.anchor_mm = {80, 60};
    scene.placement.rotation_deg = rotation_deg;
    placed_.emplace(scene, asset);
    bone_ = *make_bone_volume(scene, placed_->sheets);
    turn_ = rotation_deg * std::numbers::pi / 180;
  }
  /// `x_mm`: along the body's x. `sheet`: counted from the top. The front is at the sheet's top.
  std::optional<Vector2d> slope(double x_mm, int sheet) const {
    const Vector2d at_m = 1e-3 * x_mm * along();
    return surface_slope(bone_, placed_->sheets, sheet, bone_.sheets[sheet].top_m, at_m);
  }
  Vector2d along() const { return {std::cos(turn_), std::sin(turn_)}; }

  double spacing_m_;
  std::optional<test::Placed> placed_;
  BoneVolume bone_;
  double turn_ = 0;
};

// Towards -x the slices reach further, the deeper they are.
TEST(SurfaceSlope, IsExactOnAPlane) {
  for (const double spacing_mm : {0.5, 1.0, 2.0}) {
    for (const double slope : {0.3, 0.5, 1.0, 1.5}) {
      for (const double rotation_deg : {0.0, 50.0, 200.0}) {
        const double run_mm = spacing_mm / slope;
        const Body body(
            12, spacing_mm, [&](int below) { return -run_mm * below; }, rotation_deg);
        // The edge of sheet k is at -20 - run * k, and the surface is half way between sheets 5 and 6.
        const double x_mm = -20 - run_mm * 5.5;
        const auto got = body.slope(x_mm, 6);
        ASSERT_TRUE(got) << spacing_mm << ", " << slope;
        EXPECT_NEAR((*got - -slope * body.along()).norm(), 0, 0.01 * slope)
            << spacing_mm << ", " << slope << ", " << rotation_deg;
        // A tool that touches a slice above with its rim feels the same plane.
        const auto rim = body.slope(x_mm, 5);
        ASSERT_TRUE(rim);
        EXPECT_NEAR((*rim - *got).norm(), 0, 0.01 * slope);
      }
    }
  }
}

// Outlines that move by whole pixels of 0.4 mm.
TEST(SurfaceSlope, IsCloseOnAPlaneOfWholePixels) {
  constexpr double kPixel_mm = 0.4;
  const Body body(16, 1,
                  [&](int below) { return -kPixel_mm * std::floor(below / kPixel_mm + 0.5); });
  for (int sheet = 4; sheet < 12; ++sheet) {
    for (int step = 1; step <= 8; ++step) {
      const double off_mm = 0.1 * step;
      const auto got = body.slope(-20 - sheet + off_mm, sheet);
      if (!got) continue;  // the tip is in the sheet above
      EXPECT_NEAR(got->x(), -1, 0.08) << sheet << ", " << off_mm;
    }
  }
}

TEST(SurfaceSlope, TheEndOfABodyIsLevelAndItsInsideHasNoSurface) {
  const Body body(10, 1, [](int) { return 0.0; });
  const auto top = body.slope(0, 0);
  ASSERT_TRUE(top);
  EXPECT_EQ(top->norm(), 0);
  EXPECT_FALSE(body.slope(0, 1));
  EXPECT_FALSE(body.slope(0, 9));
  EXPECT_FALSE(body.slope(-30, 0)) << "nothing is near";
}

TEST(SurfaceSlope, AWideStepIsLevel) {
  const Body body(10, 1, [](int below) { return below < 4 ? 0.0 : -12.0; });
  const auto step = body.slope(-27, 4);
  ASSERT_TRUE(step);
  EXPECT_EQ(step->norm(), 0);
}

// Beside a vertical side the face of the tip touches the rim. A flat tip has no face.
TEST(SurfaceSlope, BesideARimItIsThatOfTheTipsFace) {
  for (const auto& [half_angle_deg, wanted] :
       {std::pair{30.0, kMaxSlope}, {45.0, 1.0}, {90.0, 0.0}}) {
    const Body body(
        10, 1, [](int) { return 0.0; }, 0, half_angle_deg);
    const auto left = body.slope(-20.5, 0), right = body.slope(20.5, 0);
    ASSERT_TRUE(left && right);
    EXPECT_NEAR(left->x(), -wanted, 1e-6);
    EXPECT_NEAR(right->x(), wanted, 1e-6);
    EXPECT_NEAR(left->y(), 0, 1e-6);
    // The bottom of a body: nothing is below.
    const auto lowest = body.slope(-20.5, 9);
    ASSERT_TRUE(lowest);
    EXPECT_NEAR(lowest->x(), -wanted, 1e-6);
  }
}

}  // namespace
}  // namespace trocar::runtime
