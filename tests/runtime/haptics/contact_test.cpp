// SPDX-License-Identifier: Apache-2.0
// The contract of runtime/haptics/puncture.h, point by point.
#include <gtest/gtest.h>

#include "runtime/haptics/puncture.h"
#include "tests/runtime/haptics/contact_fixture.h"

namespace trocar::runtime {
namespace {

TEST_F(ContactTest, Contract1ContactBeginsFromAboveWithMaterialUnderTheTool) {
  EXPECT_EQ(tick(at(0, 0, 0.125)).phase, ContactPhase::kFree);
  EXPECT_EQ(tick(at(0, 0, kTop_m)).phase, ContactPhase::kFree) << "at the height is not below";
  EXPECT_EQ(tick(at(0, 0, kTop_m - 1e-4)).phase, ContactPhase::kContact);
}

TEST_F(ContactTest, Contract1BesideTheMaterialThereIsNoForceUntilTheTipWasAbove) {
  tick(at(0.024, 0, 0.125));
  for (const double x_m : {0.024, 0.01, 0.0}) {  // then under the sheet
    const ContactOutput output = tick(at(x_m, 0, 0.115));
    EXPECT_EQ(output.phase, ContactPhase::kMissed);
    EXPECT_EQ(output.force_N, 0);
    EXPECT_EQ(output.penetration_m, 0);
  }
  tick(at(0, 0, 0.121));
  EXPECT_EQ(tick(at(0, 0, 0.119)).phase, ContactPhase::kContact);
}

TEST_F(ContactTest, Contract1NoForceIfTheSessionStartsBelowTheSheet) {
  EXPECT_EQ(tick(at(0, 0, 0.115)).phase, ContactPhase::kMissed);
  EXPECT_EQ(tick(at(0, 0, 0.118)).force_N, 0);
}

TEST_F(ContactTest, Contract2HookeForceIsStiffnessTimesOverlapTimesDepth) {
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
  // Wholly past the edge: contact ends, and there is no force on the way back under the sheet.
  EXPECT_EQ(tick(at(0.024, 0, kTop_m - 4e-3)).force_N, 0);
  EXPECT_EQ(tick(at(0, 0, kTop_m - 4e-3)).force_N, 0);
}

TEST_F(ContactTest, Contract2DampingActsOnTheRateAndTheForceIsNeverNegative) {
  Tissue damped;
  damped.damping_N_s_per_m = 10;
  set_tissue(damped);
  tick(at(0, 0, 0.125));
  EXPECT_NEAR(tick(at(0, 0, kTop_m - 1e-3)).force_N, 5, 1e-9) << "no rate at first contact";
  EXPECT_NEAR(tick(at(0, 0, kTop_m - 1.1e-3)).force_N, 5.5 + 10 * 0.1, 1e-8);
  EXPECT_EQ(tick(at(0, 0, kTop_m - 0.1e-3)).force_N, 0) << "0.5 N - 10 N";
}

TEST_F(ContactTest, Contract3PunctureInTheTickThatExceedsTheThresholdNotAtIt) {
  Tissue round;
  round.stiffness_N_per_m = 4096;
  round.threshold_N = 32;  // dx = 2^-7 m exactly
  set_tissue(round);
  tick(at(0, 0, 0.125));
  const double at_threshold_m = 0x1p-7;
  // A sheet at a height that makes dx exact.
  auto exact = std::make_unique<Sheet>(*sheets_[0]);
  exact->z_m = 0.125;
  sheets_[0] = exact.get();
  tick(at(0, 0, 0.13));
  const ContactOutput at_threshold = tick(at(0, 0, 0.125 - at_threshold_m));
  EXPECT_EQ(at_threshold.force_N, 32);
  EXPECT_FALSE(at_threshold.punctured_now);
  const ContactOutput beyond = tick(at(0, 0, 0.125 - at_threshold_m - 1e-9));
  EXPECT_TRUE(beyond.punctured_now);
  EXPECT_EQ(beyond.force_N, 0);
  EXPECT_GT(beyond.trial_force_N, 32);
  EXPECT_EQ(beyond.phase, ContactPhase::kPunctured);
  EXPECT_EQ(beyond.cut.sheet, 0);
  EXPECT_EQ(beyond.cut.cut, 1U);
  EXPECT_EQ(beyond.cut.outline,
            outline_on_lattice(model_.tool, at(0, 0, 0.1), exact->transform, 0.125));
  for (const double z_m : {0.11, 0.1, 0.1249, 0.12}) {
    const ContactOutput after = tick(at(0, 0, z_m));
    EXPECT_EQ(after.force_N, 0);
    EXPECT_FALSE(after.punctured_now);
    EXPECT_EQ(after.phase, ContactPhase::kPunctured);
  }
}

TEST_F(ContactTest, Contract3AShareOfTheToolBreaksAtItsShareOfTheThreshold) {
  for (const double x_m : {0.02, 0.0215, 0.0185}) {  // over the edge at 20 mm
    place({kTop_m});
    tick(at(x_m, 0, 0.125));
    const ContactOutput before = tick(at(x_m, 0, kTop_m - 6.99e-3));
    const double share = before.force_N / (5000 * 6.99e-3);
    EXPECT_EQ(before.phase, ContactPhase::kContact) << x_m;
    EXPECT_GT(share, 0.1);
    EXPECT_LT(share, 0.9);
    const ContactOutput beyond = tick(at(x_m, 0, kTop_m - 7.01e-3));
    EXPECT_TRUE(beyond.punctured_now) << x_m;
    EXPECT_EQ(beyond.force_N, 0);
    EXPECT_NEAR(beyond.trial_force_N, share * 5000 * 7.01e-3, 1e-9);
  }
  // The same holds with `network`, where the force is not proportional to the coverage.
  model_.uses_prefetched_stiffness = true;
  response_ = {0, 3000, {}};
  place({kTop_m});
  tick(at(0.02, 0, 0.125));  // half over the edge: up to 17.5 N
  EXPECT_NEAR(tick(at(0.02, 0, kTop_m - 5.8e-3)).force_N, 17.4, 1e-9);
  EXPECT_TRUE(tick(at(0.02, 0, kTop_m - 5.9e-3)).punctured_now);
}

TEST_F(ContactTest, Contract3AShareThatIsTooSmallForAContactSlipsOffInsteadOfBreaking) {
  place({0.120, 0.118});
  const auto slide_to = [&](double x_m, double z_m) {
    tick(at(0.02, 0, 0.125));
    tick(at(0.02, 0, z_m));
    return tick(at(x_m, 0, z_m));
  };
  // 0.55 mm of the tool's corner over the material: 2 % of its area. Contact lasts, smoothly.
  const ContactOutput shallow = slide_to(0.02245, 0.1135);
  EXPECT_EQ(shallow.phase, ContactPhase::kContact);
  EXPECT_GT(shallow.force_N, 0.01 * 32.5);
  EXPECT_LT(shallow.force_N, 0.05 * 32.5);
  // Deeper than 7 mm it would break: no hole for so little. The sheet below is beside as well.
  const ContactOutput deep = tick(at(0.02245, 0, 0.1129));
  EXPECT_EQ(deep.phase, ContactPhase::kMissed);
  EXPECT_FALSE(deep.punctured_now);
  EXPECT_EQ(deep.active_sheet, 1) << "nothing shields the sheet below";
  EXPECT_EQ(deep.wrench_device, Wrench::Zero());
  EXPECT_EQ(tick(at(0, 0, 0.1129)).force_N, 0) << "passed beside until the tip was above";
}

TEST_F(ContactTest, Contract4TheTopmostSheetBearsTheForceAndShieldsTheOthers) {
  place({0.120, 0.118, 0.116});
  tick(at(0, 0, 0.125));
  ContactOutput output = tick(at(0, 0, 0.1135));  // below all three, 6.5 mm into the first
  EXPECT_EQ(output.active_sheet, 0);
  EXPECT_NEAR(output.force_N, 5000 * 6.5e-3, 1e-9);
  output = tick(at(0, 0, 0.1125));  // 7.5 mm: the first is punctured
  EXPECT_TRUE(output.punctured_now);
  EXPECT_EQ(output.active_sheet, 0);
  EXPECT_EQ(output.force_N, 0) << "the second is shielded in this tick";
  output = tick(at(0, 0, 0.1125));  // 5.5 mm into the second
  EXPECT_EQ(output.active_sheet, 1);
  EXPECT_NEAR(output.force_N, 5000 * 5.5e-3, 1e-9);
  output = tick(at(0, 0, 0.105));  // 13 mm: the second is punctured
  EXPECT_TRUE(output.punctured_now);
  output = tick(at(0, 0, 0.105));  // 11 mm into the third: punctured in its first tick
  EXPECT_TRUE(output.punctured_now);
  EXPECT_EQ(output.active_sheet, 2);
  EXPECT_EQ(output.force_N, 0);
  EXPECT_EQ(tick(at(0, 0, 0.105)).force_N, 0);
}

TEST_F(ContactTest, Contract4WithdrawalDoesNotPunctureAShieldedSheet) {
  place({0.120, 0.118});
  tick(at(0, 0, 0.125));
  tick(at(0, 0, 0.114));
  EXPECT_EQ(tick(at(0, 0, 0.119)).active_sheet, 0);
  EXPECT_EQ(tick(at(0, 0, 0.121)).phase, ContactPhase::kFree);
  EXPECT_EQ(state_.tracks[1].cuts_requested, 0U);
}

TEST_F(ContactTest, Contract5AHoleIsOpenBeforeAndAfterItsMeshIsThere) {
  tick(at(0, 0, 0.125));
  const ContactOutput puncture = tick(at(0, 0, 0.112));
  ASSERT_TRUE(puncture.punctured_now);
  for (const bool published : {false, true}) {
    if (published) publish(puncture.cut);
    EXPECT_EQ(tick(at(0, 0, 0.121)).phase, ContactPhase::kFree);
    EXPECT_EQ(tick(at(0, 0, 0.115)).phase, ContactPhase::kMissed) << published;
    EXPECT_EQ(tick(at(0, 0, 0.111)).force_N, 0);
    // A few micrometres beside it the tool is still in its hole.
    tick(at(4e-6, -3e-6, 0.121));
    EXPECT_EQ(tick(at(4e-6, -3e-6, 0.115)).phase, ContactPhase::kMissed) << published;
    // Half a tool further about half of the outline is over material.
    tick(at(0.003, 0, 0.121));
    const double force_N = tick(at(0.003, 0, 0.119)).force_N;
    EXPECT_GT(force_N, 0.3 * 5);
    EXPECT_LT(force_N, 0.8 * 5);
    // Away from the hole the sheet is intact.
    tick(at(0.01, 0, 0.121));
    EXPECT_NEAR(tick(at(0.01, 0, 0.119)).force_N, 5, 1e-9);
  }
  EXPECT_EQ(state_.tracks[0].pending_count, 0) << "the mesh has the hole now";
}

TEST_F(ContactTest, Contract5PendingHolesArePublishedInOrderAndTooManyAreABacklog) {
  std::vector<CutRequest> requests;
  const auto puncture = [&](double x_m) {
    tick(at(x_m, 0, 0.125));
    ContactOutput output = tick(at(x_m, 0, 0.112));
    if (output.punctured_now) requests.push_back(output.cut);
    return output;
  };
  for (int i = 0; i < kMaxPendingHoles; ++i)
    EXPECT_TRUE(puncture(-0.015 + 0.007 * i).punctured_now);
  const ContactOutput full = puncture(0.015);
  EXPECT_TRUE(full.backlog);
  EXPECT_FALSE(full.punctured_now);
  EXPECT_EQ(full.force_N, 0);
  publish(requests[0]);
  publish(requests[1]);
  tick(at(0, 0, 0.125));
  EXPECT_EQ(state_.tracks[0].pending_count, 2);
  EXPECT_EQ(state_.tracks[0].pending[0], requests[2].outline);
  for (int i = 0; i < kMaxPendingHoles; ++i) {
    tick(at(-0.015 + 0.007 * i, 0, 0.125));
    EXPECT_EQ(tick(at(-0.015 + 0.007 * i, 0, 0.115)).phase, ContactPhase::kMissed) << i;
  }
  EXPECT_TRUE(puncture(0.015).punctured_now) << "the published holes have left the list";
  EXPECT_EQ(requests.back().cut, 5U);
}

TEST_F(ContactTest, Contract2TheForceActsInTheCentroidOfTheOverlap) {
  tick(at(0, 0, 0.125));
  ContactOutput output = tick(at(0.001, 0.002, kTop_m - 4e-3));
  EXPECT_LT((output.wrench_device - (Wrench() << 0, 0, 20, 0, 0, 0).finished()).norm(), 1e-4)
      << "the middle of the tool is the plate's origin, up to rounding of the corners";
  // Half over the edge: half a hexagon is a rectangle (to r / 2) and a triangle (from there to r).
  output = tick(at(0.02, 0, kTop_m - 4e-3));
  const double r = 0.003;
  const double rectangle = 2, triangle = 1;  // areas
  const double centroid_m =
      -(rectangle * r / 4 + triangle * (r / 2 + r / 6)) / (rectangle + triangle);
  EXPECT_NEAR(output.wrench_device[4] / -output.wrench_device[2], centroid_m, 1e-5);
  EXPECT_NEAR(output.wrench_device[3], 0, 1e-4);
}

TEST_F(ContactTest, Contract2NetworkUsesThePublishedResponse) {
  model_.uses_prefetched_stiffness = true;
  EXPECT_EQ(tick(at(0, 0, 0.16)).prefetch.sheet, -1) << "too far above";
  const ContactOutput near = tick(at(0.001, 0, 0.125));
  ASSERT_EQ(near.prefetch.sheet, 0);
  EXPECT_EQ(near.prefetch.outline,
            outline_on_lattice(model_.tool, at(0.001, 0, 0.125), sheets_[0]->transform, kTop_m));
  // Without a response: Hooke's law.
  EXPECT_NEAR(tick(at(0, 0, kTop_m - 1e-3)).force_N, 5, 1e-9);
  // The force approaches a prefetched stiffness without a step or overshoot, and reaches it.
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
  // A stiffness prefetched before the contact acts from the first tick on.
  tick(at(0, 0, 0.125));
  EXPECT_NEAR(tick(at(0, 0, kTop_m - 1e-3)).force_N, 3, 1e-12);
  // A response of another sheet is not used.
  response_.sheet = 1;
  tick(at(0, 0, 0.125));
  EXPECT_NEAR(tick(at(0, 0, kTop_m - 1e-3)).force_N, 5, 1e-9);
  // After a puncture the next sheet's response is requested.
  place({0.12, 0.11});
  tick(at(0, 0, 0.125));
  EXPECT_EQ(tick(at(0, 0, 0.1125)).prefetch.sheet, 1);
}

TEST_F(ContactTest, EachSheetHasItsTissueAndItsHoleActsOnTheShaft) {
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
  EXPECT_TRUE(tick(at(0, 0, 0.1179)).punctured_now);
  ContactOutput output = tick(at(0, 0, 0.1129));  // 5 mm further: full friction
  EXPECT_EQ(output.force_N, 0);
  EXPECT_NEAR(output.wrench_device[2], 3, 1e-12);
  output = tick(at(0, 0, 0.108));  // friction adds to the force of the next sheet
  EXPECT_NEAR(output.force_N, 10, 1e-9);
  EXPECT_NEAR(output.wrench_device[2], 13, 1e-9);
  // Displaced by 1 mm: the rim's force in the sheet's plane, and its moment.
  output = tick(at(0.001, 0, 0.108));
  EXPECT_NEAR(output.wrench_device[0], -2, 1e-9);
  EXPECT_NEAR(output.wrench_device[4], 0.012 * -2, 1e-4);
}

/// Sheets whose holes hold the shaft: 3 N of friction, and a rim.
class HoleTest : public ContactTest {
 protected:
  void SetUp() override {
    place({kTop_m});
    hold();
  }
  void hold() {
    Tissue tissue;
    tissue.shaft.dry_friction_N = 3;
    tissue.shaft.rim_stiffness_N_per_m = 2000;
    set_tissue(tissue);
  }
  ContactOutput puncture(double x_m, double y_m = 0) {
    tick(at(x_m, y_m, 0.125));
    ContactOutput output = tick(at(x_m, y_m, 0.112));
    EXPECT_TRUE(output.punctured_now);
    return output;
  }
  /// The wrench of the second tick below the sheet, 1 mm deeper than the first, after the tip was
  /// above.
  Wrench again(double x_m, double y_m = 0) {
    EXPECT_EQ(tick(at(x_m, y_m, 0.121)).wrench_device, Wrench::Zero());
    const ContactOutput entered = tick(at(x_m, y_m, 0.1195));
    EXPECT_EQ(entered.phase, ContactPhase::kMissed);
    EXPECT_EQ(entered.wrench_device, Wrench::Zero()) << "no step on entering";
    return tick(at(x_m, y_m, 0.1185)).wrench_device;
  }
};

TEST_F(HoleTest, Contract7AHoleKeepsItsFrictionAndItsRim) {
  const ContactOutput first = puncture(0);
  for (const bool published : {false, true}) {
    if (published) publish(first.cut);
    for (int pass = 0; pass < 3; ++pass) {
      EXPECT_NEAR(again(0)[2], 3, 1e-12);
      EXPECT_NEAR(tick(at(0.001, 0, 0.1175)).wrench_device[0], -2, 1e-9) << "the rim";
      EXPECT_LT(tick(at(0, 0, 0.119)).wrench_device[2], 0) << "drawn out";
    }
    // 0.1 mm off centre 2 % of the tool are over material. The rim acts from there on.
    const Wrench off = again(1e-4);
    EXPECT_NEAR(off[2], 3, 1e-12);
    EXPECT_NEAR(off[0], 0, 1e-12) << "no energy from nothing";
    EXPECT_NEAR(tick(at(1.1e-3, 0, 0.1175)).wrench_device[0], -2, 1e-9);
    // 0.5 mm off centre it is in contact, without friction.
    tick(at(5e-4, 0, 0.121));
    EXPECT_EQ(tick(at(5e-4, 0, 0.119)).phase, ContactPhase::kContact);
    // Beside the sheet there is no hole.
    EXPECT_EQ(again(0.024), Wrench::Zero());
  }
}

TEST_F(HoleTest, Contract7TheRimStartsAgainAfterTicksWithoutForce) {
  puncture(0);
  reset_motion(state_);
  const ContactOutput moved = tick(at(0.01, 0, 0.115));
  EXPECT_EQ(moved.wrench_device, Wrench::Zero()) << "moved sideways while there were no forces";
  EXPECT_EQ(moved.local.stored_J, 0);
  EXPECT_NEAR(tick(at(0.011, 0, 0.115)).wrench_device[0], -2, 1e-9) << "the rim acts from there on";
}

TEST_F(HoleTest, Contract7HolesThatOverlapAreOne) {
  // Between two holes 3 mm apart a third of the tool is outside of either, and nothing of both.
  publish(puncture(0).cut);
  publish(puncture(0.003).cut);
  for (const double x_m : {0.0, 0.003, 0.0015})
    EXPECT_NEAR(again(x_m)[2], 3, 1e-9) << x_m;
}

TEST_F(HoleTest, Contract7TheToolThatSlidesIntoAHoleIsInIt) {
  puncture(0);
  tick(at(0.005, 0, 0.125));
  EXPECT_EQ(tick(at(0.005, 0, 0.118)).phase, ContactPhase::kContact);
  EXPECT_EQ(tick(at(0, 0, 0.118)).wrench_device, Wrench::Zero()) << "slid off the material";
  EXPECT_NEAR(tick(at(0, 0, 0.117)).wrench_device[2], 3, 1e-12);
}

TEST_F(HoleTest, Contract7AShieldedHoleHoldsTheShaftOnceTheSheetAboveIsPunctured) {
  place({0.120, 0.115});
  hold();
  puncture(0);  // of the upper sheet
  tick(at(0.006, 0, 0.1149));
  EXPECT_EQ(tick(at(0.006, 0, 0.1075)).cut.sheet, 1);
  // The lower one has its hole at x = 6 mm, where the upper one is intact.
  tick(at(0.006, 0, 0.125));
  EXPECT_NEAR(tick(at(0.006, 0, 0.1135)).wrench_device[2], 32.5, 1e-9) << "no friction";
  EXPECT_EQ(tick(at(0.006, 0, 0.1125)).cut.sheet, 0);
  EXPECT_EQ(tick(at(0.006, 0, 0.1125)).wrench_device[2], 0);
  EXPECT_NEAR(tick(at(0.006, 0, 0.1115)).wrench_device[2], 6, 1e-9) << "both holes";
}

TEST_F(HoleTest, Contract7AHoleOverTheEdgeHoldsTheShaftByItsShare) {
  puncture(0.02);  // half over the edge
  EXPECT_NEAR(tick(at(0.02, 0, 0.111)).wrench_device[2], 1.5, 2e-3);
  EXPECT_NEAR(tick(at(0.021, 0, 0.110)).wrench_device[0], -1, 2e-3);
  EXPECT_NEAR(again(0.02)[2], 1.5, 2e-3);
  // Further out the tool touches neither the sheet nor its hole's rim.
  EXPECT_EQ(again(0.0232), Wrench::Zero());
}

TEST_F(HoleTest, Contract7ASliverBesideAHoleMakesAWholeHole) {
  publish(puncture(0).cut);
  const ContactOutput sliver = puncture(5e-4);
  EXPECT_NEAR(sliver.trial_force_N, 5000 * 8e-3 / 9, 1e-2) << "a ninth of the tool";
  EXPECT_NEAR(tick(at(5e-4, 0, 0.111)).wrench_device[2], 3, 1e-9);
}

TEST_F(HoleTest, Contract7ASheetRemembersItsLastHoles) {
  const auto place_m = [](int k) {
    const int column = k % 9 - 4, row = k / 9 - 4;
    return Eigen::Vector2d(0.004 * column, 0.004 * row);
  };
  // Tools of 1.5 mm, so that 81 holes fit in the sheet.
  SceneTool shape;
  shape.radius_m = 0.0015;
  model_.tool = make_tool(shape);
  const int most = kMaxHoles, all = most + 5;
  ASSERT_LE(all, 81);
  for (int k = 0; k < all; ++k)
    publish(puncture(place_m(k).x(), place_m(k).y()).cut);
  for (int k = 0; k < all; ++k) {
    EXPECT_NEAR(again(place_m(k).x(), place_m(k).y())[2], k < all - most ? 0 : 3, 1e-9) << k;
  }
}

}  // namespace
}  // namespace trocar::runtime
