// SPDX-License-Identifier: Apache-2.0
// Which walls and which strength the law `cutting` gives the tool in a hole: in a hole elsewhere,
// in a hole entered again, and with a coupling that holds the tool far from the plate. (Contract of
// bone_contact.h.)
#include <gtest/gtest.h>

#include "tests/runtime/haptics/bone/dry_run.h"
#include "tests/support/body_fixture.h"

namespace trocar::runtime {
namespace {

using test::body_scene;
using test::kHexagon_m2;
using test::spaced_asset;

// The tool hovers beside the bone, over the topmost slices, before it drills elsewhere. What was
// free beside the bone is not free in the hole.
TEST(HoleContact, AHoleInSolidBoneHasItsWallsWhereverTheToolWasBefore) {
  const auto side_N = [](bool was_beside) {
    DryRun trial(walled(), spaced_asset(10, 1));
    if (was_beside) trial.move(25e-3, 0.121, 10e-3, 0.121);
    trial.move(10e-3, 0.121, 10e-3, 0.1171);
    trial.move(10e-3, 0.1171, 12e-3, 0.1171);
    return trial.side_N();
  };
  // 5 MPa over the width of 5.46 mm and the depth of 3.3 mm.
  EXPECT_LT(side_N(false), -80);
  EXPECT_NEAR(side_N(true), side_N(false), 1e-6);
}

TEST(HoleContact, AWallThatYieldsInAHoleEnteredAgainStaysWhereItWasPushed) {
  DryRun trial(walled(), spaced_asset(10, 1));
  trial.move(0, 0.121, 0, 0.1171);
  trial.publish();
  trial.move(0, 0.1171, 0, 0.121);
  // Beside the old axis by less than CuttingOptions::same_hole_m, so that little material is under
  // the tool.
  trial.move(0, 0.121, 30e-6, 0.121);
  trial.move(30e-6, 0.121, 30e-6, 0.1171);
  EXPECT_EQ(trial.sides_, 0);
  trial.move(30e-6, 0.1171, 3e-3, 0.1171);
  EXPECT_LT(trial.side_N(), -80) << "the walls have yielded";
  EXPECT_GT(trial.sides_, 0) << "and are cut";
  trial.move(3e-3, 0.1171, 1e-3, 0.1171);
  EXPECT_NEAR(trial.side_N(), 0, 1) << "they do not close behind the shaft";
}

TEST(HoleContact, AHoleEnteredAgainIsAsWideAsItWasLeft) {
  DryRun trial(walled(), spaced_asset(10, 1));
  trial.move(0, 0.121, 0, 0.1171);
  trial.move(0, 0.1171, 2.5e-3, 0.1171);  // the walls yield by 2 mm
  EXPECT_GT(trial.sides_, 0);
  trial.publish();
  trial.move(2.5e-3, 0.1171, 1e-3, 0.1171);
  trial.move(1e-3, 0.1171, 1e-3, 0.121);
  trial.move(1e-3, 0.121, 1e-3, 0.1171);
  for (const double x_m : {1.9e-3, 0.1e-3, 1e-3}) {
    trial.move(trial.state_.T_device_plate.p_m.x(), 0.1171, x_m, 0.1171);
    EXPECT_NEAR(trial.side_N(), 0, 1) << x_m;
  }
}

// The walls hold the needle while the hand pulls the plate so far aside that no bone is under the
// plate's tool.
TEST(HoleContact, ACoupledToolCutsTheBoneUnderItselfNotUnderThePlate) {
  DryRun trial(walled(), spaced_asset(10, 1), false);
  trial.move(16.3e-3, 0.121, 16.3e-3, 0.1172);
  trial.move(16.3e-3, 0.1172, 23.2e-3, 0.1172);
  EXPECT_LT(trial.state_.law.T_device_proxy.p_m.x(), 17e-3) << "the bone ends at 20 mm";
  const int fronts = trial.fronts_;
  trial.peak_N_ = 0;
  trial.move(23.2e-3, 0.1172, 23.2e-3, 0.1132);
  EXPECT_NEAR(trial.peak_N_, 0.2e6 * kHexagon_m2, 1e-3);
  EXPECT_EQ(trial.fronts_, fronts + 4);
}

// The bone's edge holds the needle in the air beside the bone, while the hand pushes the plate over
// the bone.
TEST(HoleContact, ACoupledToolBesideTheBoneIsNotStoppedByTheBoneUnderThePlate) {
  DryRun trial(walled(), spaced_asset(10, 1), false);
  trial.move(25e-3, 0.121, 25e-3, 0.117);
  trial.move(25e-3, 0.117, 17e-3, 0.117);
  EXPECT_GT(trial.state_.law.T_device_proxy.p_m.x(), 22.2e-3) << "it would touch at 22.7 mm";
  trial.peak_N_ = 0;
  trial.move(17e-3, 0.117, 17e-3, 0.113);
  EXPECT_LT(trial.peak_N_, 0.5) << "a corner of the tool is over the edge";
}

// Slices at 0, 1 and 4 mm: the bone of the slices is 1, 2 and 3 mm thick, and the shell below ends
// in the middle one.
TEST(HoleContact, AShellIsAsThickInSlicesOfUnevenSpacing) {
  Asset asset = spaced_asset(3, 1);
  asset.slices[2].z_mm = 4;
  Scene scene = body_scene(0, 2, 0.12);
  scene.body->shell_m = 1.25e-3;
  scene.body->shell_factor = 3;
  scene.tissue.threshold_N = 10;
  scene.tissue.stiffness_N_per_m = 50'000;
  DryRun trial(scene, asset);
  trial.move(0, 0.1225, 0, 0.114);
  EXPECT_NEAR(trial.peak_N_, 30, 1e-6);
  EXPECT_NEAR(trial.state_.energy.cut_J, 2 * 30 * 1.25e-3 + 10 * (6e-3 - 2 * 1.25e-3), 1e-6);
}

}  // namespace
}  // namespace trocar::runtime
