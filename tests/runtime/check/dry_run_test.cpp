// SPDX-License-Identifier: Apache-2.0
// The dry runs in which the hand lets go.
#include "runtime/check/dry_run.h"

#include <gtest/gtest.h>

#include <memory>

#include "runtime/session/open_device.h"
#include "tests/support/handle_device.h"
#include "tests/support/sheet_fixture.h"

namespace trocar::runtime {
namespace {

TEST(LettingGo, StatesTheFaultOfTheFirstRunThatHadOne) {
  const Scene scene = test::descent_scene({0.12}, 0.13, 0.105, 0.05);
  Scene leaves_workspace = scene;
  leaves_workspace.hand.trajectory = {{0, {0, 0, 0.13}, {}}, {0.5, {0.1, 0, 0.13}, {}}};
  const test::HandleSpecification stops_early(50, 0.11), stops_late(50);
  int made = 0;
  const DeviceToCheck device{
      stops_late, [&](const Scene&) -> Result<std::shared_ptr<HandDevice>> {
        const bool is_first = ++made == 1;
        return std::shared_ptr<HandDevice>(std::make_shared<test::HandleDevice>(
            is_first ? stops_early : stops_late,
            hand_trajectory(is_first ? scene : leaves_workspace)));
      }};
  SessionOptions options;
  options.clock = Clock::kVirtual;
  options.duration_s = scene.duration_s;
  DryRun had_contact;
  had_contact.feel.contact_from_s = 0.2;
  had_contact.feel.contact_to_s = 0.3;
  had_contact.feel.wanted_most = {1, 0.25};
  const auto sheets = place_slices(scene, test::square_asset(1), "a");
  ASSERT_TRUE(sheets);
  const auto trial = try_letting_go(scene, device, *sheets, options, had_contact);
  ASSERT_TRUE(trial) << trial.error().message;
  ASSERT_TRUE(*trial);
  EXPECT_EQ((*trial)->moments, kLetGoMoments);
  EXPECT_EQ((*trial)->fault, Fault::kPoseResidual);
}

}  // namespace
}  // namespace trocar::runtime
