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

std::string usage_error(const Result<void>& checked) {
  if (checked) return "accepted";
  EXPECT_EQ(checked.error().code, ExitCode::kUsage);
  return checked.error().message;
}

TEST(OpenDevice, HelpNamesEveryUri) {
  const std::string help = device_uri_help();
  EXPECT_TRUE(help.starts_with(
      "inproc: simulated in this process;\n"
      "udp:HOST:PORT: another process that drives the device, such as trocar-device-sim;\n"
      "pose:HOST:PORT: "))
      << help;
  for (const char* uri : {"haply:[HOST[:PORT]]: ", "forcedimension:[ID]: "})
    EXPECT_NE(help.find(uri), std::string::npos) << uri;
}

TEST(OpenDevice, UnknownUrisAreUsageErrors) {
  for (const char* uri : {"", "udp", "inproc:", "inproc:x", "serial:/dev/ttyS0", "UDP:a:1"}) {
    EXPECT_EQ(usage_error(check_device_uri(uri, false)),
              "--device " + std::string(uri) +
                  ": must be inproc or udp:HOST:PORT or pose:HOST:PORT or haply:[HOST[:PORT]] or "
                  "forcedimension:[ID]");
    EXPECT_FALSE(Opened().open(uri));
  }
}

TEST(OpenDevice, KeyFileIsRequiredForTheLinkOnly) {
  EXPECT_TRUE(check_device_uri("inproc", false));
  EXPECT_TRUE(check_device_uri("udp:127.0.0.1:4840", true));
  EXPECT_EQ(usage_error(check_device_uri("udp:127.0.0.1:4840", false)),
            "--device udp:127.0.0.1:4840: needs --key-file");
  EXPECT_EQ(usage_error(check_device_uri("inproc", true)),
            "--key-file: is for --device udp:HOST:PORT or pose:HOST:PORT only");
}

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

TEST(OpenDevice, ErrorsNameTheSceneTheAddressOrTheKeyFile) {
  Opened out_of_reach;
  out_of_reach.scene.hand.trajectory[0].tip_m = {0, 0, 1};
  const auto scene = out_of_reach.open("inproc");
  ASSERT_FALSE(scene);
  EXPECT_EQ(scene.error().code, ExitCode::kRefused);
  EXPECT_TRUE(scene.error().message.starts_with("scene.json: "));
  const auto address = Opened().open("udp:127.0.0.1", "key");
  ASSERT_FALSE(address);
  EXPECT_EQ(address.error().code, ExitCode::kUsage);
  EXPECT_NE(address.error().message.find("127.0.0.1"), std::string::npos);
  const auto key = Opened().open("udp:127.0.0.1:4840", "absent.key");
  ASSERT_FALSE(key);
  EXPECT_EQ(key.error().code, ExitCode::kRefused);
  EXPECT_NE(key.error().message.find("absent.key"), std::string::npos);
}

}  // namespace
}  // namespace trocar::runtime
