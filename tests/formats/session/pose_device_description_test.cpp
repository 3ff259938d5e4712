// SPDX-License-Identifier: Apache-2.0
// Descriptions of pose devices: what is read, and what is refused with which words.
#include "formats/session/device_description.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>
#include <numbers>

#include "tests/support/temporary_folder.h"

namespace trocar {
namespace {

/// A description with every field; `from` is replaced by `to`.
std::string text_with(const std::string& from = "", const std::string& to = "") {
  std::string text = R"({
    "schema": "trocar.pose_device/1", "name": "arm", "force_max_N": 8, "moment_max_Nm": 0.2, "senses_rotation": true,
    "stiffness_max_N_per_m": 2000, "mass_kg": 0.25, "inertia_kg_m2": [1e-4, 2e-4, 3e-4], "damping_N_s_per_m": 0.5,
    "rotation_damping_Nm_s_per_rad": 0.01, "position_resolution_m": 1e-5, "rotation_resolution_rad": 1e-3,
    "workspace_min_m": [-0.1, -0.2, 0], "workspace_max_m": [0.1, 0.2, 0.3], "turn_deg": [0, 0, 90], "buttons": 2,
    "assumed": {"/mass_kg": "weighed by hand"}})";
  if (from.empty()) return text;
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

TEST(PoseDeviceDescription, EveryFieldIsRead) {
  const auto read = parse_pose_device_description(text_with(), "arm.json");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->name, "arm");
  EXPECT_EQ(read->force_max_N, 8);
  EXPECT_EQ(read->moment_max_Nm, 0.2);
  EXPECT_TRUE(read->senses_rotation);
  EXPECT_EQ(read->stiffness_max_N_per_m, 2000);
  EXPECT_EQ(read->mass_kg, 0.25);
  EXPECT_EQ(read->inertia_kg_m2, (std::array{1e-4, 2e-4, 3e-4}));
  EXPECT_EQ(read->damping_N_s_per_m, 0.5);
  EXPECT_EQ(read->rotation_damping_Nm_s_per_rad, 0.01);
  EXPECT_EQ(read->position_resolution_m, 1e-5);
  EXPECT_EQ(read->rotation_resolution_rad, 1e-3);
  EXPECT_EQ(read->workspace_min_m, (std::array{-0.1, -0.2, 0.0}));
  EXPECT_EQ(read->workspace_max_m, (std::array{0.1, 0.2, 0.3}));
  EXPECT_DOUBLE_EQ(read->turn_rad[2], std::numbers::pi / 2);
  EXPECT_EQ(read->buttons, 2);
}

TEST(PoseDeviceDescription, FewFieldsAreEnough) {
  const auto read = parse_pose_device_description(
      R"({"schema": "trocar.pose_device/1", "name": "arm", "force_max_N": 3, "mass_kg": 0.1,
          "workspace_min_m": [0, 0, 0], "workspace_max_m": [0.1, 0.1, 0.1]})",
      "arm.json");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->moment_max_Nm, 0);
  EXPECT_FALSE(read->senses_rotation);
}

TEST(PoseDeviceDescription, WrongFieldsAreRefusedWithTheirPath) {
  const std::pair<const char*, const char*> wrong[] = {
      {"\"force_max_N\": 8", "\"force_max_N\": 0"},
      {"\"force_max_N\": 8", "\"force_max_N\": \"8\""},
      {"\"force_max_N\": 8,", ""},
      {"\"mass_kg\": 0.25", "\"mass_kg\": -1"},
      {"\"workspace_max_m\": [0.1", "\"workspace_max_m\": [-0.1"},
      {"\"workspace_max_m\": [0.1, 0.2, 0.3]", "\"workspace_max_m\": [0.1, 0.2]"},
      {"\"senses_rotation\": true", "\"senses_rotation\": 1"},
      {"\"senses_rotation\": true", "\"senses_rotation\": false"},
      {"\"inertia_kg_m2\": [1e-4, 2e-4, 3e-4], ", ""},
      {"\"buttons\": 2", "\"buttons\": 33"},
      {"\"name\": \"arm\"", "\"name\": \"arm\", \"colour\": 1"},
      {"/mass_kg", "/weight_kg"},
      {"trocar.pose_device/1", "trocar.pose_device/2"}};
  for (const auto& [from, to] : wrong) {
    const auto read = parse_pose_device_description(text_with(from, to), "arm.json");
    ASSERT_FALSE(read) << to;
    EXPECT_EQ(read.error().code, ExitCode::kRefused);
    EXPECT_TRUE(read.error().message.starts_with("arm.json: /")) << read.error().message;
  }
}

TEST(PoseDeviceDescription, SchemaStatesTheKindOfDevice) {
  const test::TemporaryFolder folder;
  const std::string file = (folder.path() / "device.json").string();
  std::ofstream(file) << text_with();
  const auto pose = read_any_device_description(file);
  ASSERT_TRUE(pose) << pose.error().message;
  EXPECT_TRUE(std::holds_alternative<PoseDeviceDescription>(*pose));
  std::ofstream(file) << "{\"schema\": \"trocar.device/1\"}";
  const auto legs = read_any_device_description(file);
  ASSERT_FALSE(legs);
  EXPECT_NE(legs.error().message.find("/name"), std::string::npos) << legs.error().message;
  EXPECT_FALSE(read_any_device_description(file + ".missing"));
}

}  // namespace
}  // namespace trocar
