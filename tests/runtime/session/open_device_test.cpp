// SPDX-License-Identifier: Apache-2.0
// Devices by URI: which URIs exist, which need a key file, and what they open.
#include "runtime/session/open_device.h"

#include <gtest/gtest.h>

#include "runtime/session/pose_session.h"

namespace trocar::runtime {
namespace {

struct Opened {
  Scene scene;
  AnyDeviceDescription description = default_device_description();
  Opened() {
    scene.tool.tip_in_plate_m = {0, 0, 0};
    scene.hand.trajectory = {{0, {0, 0, 0.15}, {}}};
  }
  Result<OpenedDevice> open(std::string_view uri, const char* key_file = "") const {
    return open_device(uri, {.scene = scene,
                             .scene_name = "scene.json",
                             .description = description,
                             .key_file = key_file,
                             .say = {}});
  }
};

TEST(OpenDevice, DescriptionMustBeOfTheDevicesKind) {
  Opened legs;
  for (const char* uri : {"haply:", "haply:127.0.0.1:1", "forcedimension:"}) {
    EXPECT_FALSE(built_in_description(uri).empty());
    EXPECT_TRUE(may_have_motors(uri));
    const auto opened = legs.open(uri);
    ASSERT_FALSE(opened);
    EXPECT_EQ(opened.error().code, ExitCode::kUsage);
    EXPECT_NE(opened.error().message.find("measures its own pose"), std::string::npos);
  }
  Opened pose;
  pose.description = *built_in_pose_device("haply_inverse3");
  const auto drive = pose.open("udp:127.0.0.1:4840", "key");
  ASSERT_FALSE(drive);
  EXPECT_NE(drive.error().message.find("has encoders and motors"), std::string::npos);
  EXPECT_TRUE(pose.open("inproc"));
  EXPECT_TRUE(built_in_description("udp:127.0.0.1:4840").empty());
}

TEST(OpenDevice, SimulatedDeviceIsPacedByTheLoop) {
  auto opened = Opened().open("inproc");
  ASSERT_TRUE(opened) << opened.error().message;
  HandDevice& device = *opened->device;
  EXPECT_TRUE(device.is_paced_by_loop());
  ASSERT_TRUE(device.start());
  double t_s = -1;
  ASSERT_EQ(device.read(t_s), DeviceStatus::kOk);
  EXPECT_EQ(t_s, 0);
  ASSERT_EQ(device.write(), DeviceStatus::kOk);
  device.advance(1e-3);
  ASSERT_EQ(device.read(t_s), DeviceStatus::kOk);
  EXPECT_EQ(t_s, 1e-3);
  device.close();
  EXPECT_FALSE(device.link_report());
}

}  // namespace
}  // namespace trocar::runtime
