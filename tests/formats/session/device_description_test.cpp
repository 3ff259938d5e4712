// SPDX-License-Identifier: Apache-2.0
#include "formats/session/device_description.h"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>

#include "tests/formats/session/documents.h"
#include "tests/support/temporary_folder.h"

namespace trocar {
namespace {

using Json = nlohmann::json;

TEST(DeviceDescription, ShippedFileEqualsTheBuiltInOne) {
  const auto device = read_device_description(TROCAR_FOUR_LEGS_JSON);
  ASSERT_TRUE(device) << device.error().message;
  EXPECT_EQ(*device, default_device_description());
}

TEST(DeviceDescription, HasThePapersLinksAndMarksAllOtherValuesAsAssumed) {
  const DeviceGeometry g = default_device_description().geometry;
  EXPECT_EQ(g.l1_m, 0.094);
  EXPECT_EQ(g.l2_m, 0.131);
  EXPECT_EQ(g.l3_m, 0.075);
  EXPECT_EQ(g.l4_m, 0.075);
  EXPECT_EQ(g.l5_m, 0.045);
  const Json document = test::documents()["device"]["good"];
  for (const auto& [section, content] : document.items()) {
    if (!content.is_object() || section == "assumed") continue;
    for (const auto& [key, value] : content.items()) {
      const bool from_paper = section == "geometry" && key.size() == 4 && key[0] == 'l';
      const std::string whole = std::string("/").append(section);
      const bool assumed = document["assumed"].contains(whole) ||
                           document["assumed"].contains(std::string(whole).append("/").append(key));
      EXPECT_NE(from_paper, assumed) << section << "/" << key;
    }
  }
}

void expect_refused(const Json& document, const std::string& place) {
  const auto device = parse_device_description(document.dump(), "device.json");
  ASSERT_FALSE(device) << document.dump();
  EXPECT_EQ(device.error().code, ExitCode::kRefused);
  EXPECT_EQ(device.error().message.rfind("device.json: ", 0), 0u) << device.error().message;
  EXPECT_NE(device.error().message.find(place), std::string::npos) << device.error().message;
  EXPECT_EQ(device.error().message.find('\n'), std::string::npos);
}

// Every value of the shipped file, one at a time: missing, of a wrong type, out of range.
TEST(DeviceDescription, EveryValueIsCheckedByName) {
  const Json document = test::documents()["device"]["good"];
  const Json flat = document.flatten();
  int leaves = 0;
  for (const auto& [pointer, value] : flat.items()) {
    if (pointer.rfind("/assumed", 0) == 0) continue;
    ++leaves;
    const Json::json_pointer place(pointer);
    const bool in_array = document[place.parent_pointer()].is_array();
    const std::string name = in_array ? place.parent_pointer().to_string() : pointer;

    Json changed = document;
    if (in_array) {
      changed[place.parent_pointer()].erase(0);
    } else {
      changed[place.parent_pointer()].erase(place.back());
    }
    // "assumed" may name the same place; the value's error comes first.
    expect_refused(changed, name);
    for (const Json& wrong : {Json(nullptr), Json(true), Json::array(), Json::object()}) {
      changed = document;
      changed[place] = wrong;
      expect_refused(changed, name);
    }
    changed = document;
    changed[place] = value.is_string() ? Json(3) : Json("3");
    expect_refused(changed, name);
    if (!value.is_number()) continue;
    for (const double wrong : {-1e6, 1e12}) {
      changed = document;
      changed[place] = wrong;
      expect_refused(changed, name);
    }
  }
  EXPECT_GT(leaves, 30);
}

TEST(DeviceDescription, MayStateTheLargestStiffness) {
  Json document = test::documents()["device"]["good"];
  EXPECT_EQ(parse_device_description(document.dump(), "d")->plate_stiffness_max_N_per_m, 0);
  document["plate"]["stiffness_max_N_per_m"] = 20'000;
  EXPECT_EQ(parse_device_description(document.dump(), "d")->plate_stiffness_max_N_per_m, 20'000);
}

TEST(DeviceDescription, BranchesMayBeMirrored) {
  Json other_branch = test::documents()["device"]["good"];
  other_branch["branches"]["theta4"] = "minus";
  const auto mirrored = parse_device_description(other_branch.dump(), "device.json");
  ASSERT_TRUE(mirrored);
  EXPECT_EQ(mirrored->geometry.branch_theta4, -1);
  expect_refused(Json::array(), "");
}

TEST(DeviceDescription, RefusesBrokenTextAndFiles) {
  const std::string text = test::documents()["device"]["good"].dump();
  for (const std::string& broken :
       {std::string(), std::string("{"), text.substr(0, text.size() / 2), text + "}",
        std::string("\xff\xfe"), std::string(100'000, '['),
        std::string("{\"schema\": \"trocar.device/1\", \"schema\": \"trocar.device/1\"}")}) {
    const auto device = parse_device_description(broken, "device.json");
    ASSERT_FALSE(device);
    EXPECT_EQ(device.error().message.rfind("device.json: ", 0), 0u);
  }
  std::string too_large_number = text;
  too_large_number.replace(too_large_number.find("0.094"), 5, "1e999");
  EXPECT_FALSE(parse_device_description(too_large_number, "device.json"));
  EXPECT_FALSE(read_device_description("/nonexistent/device.json"));
  EXPECT_FALSE(read_device_description("/"));
}

std::string pose_text() {
  return test::documents()["pose device"]["good"].dump();
}

TEST(PoseDeviceDescription, EveryFieldIsRead) {
  const auto read = parse_pose_device_description(pose_text(), "arm.json");
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

TEST(PoseDeviceDescription, SchemaStatesTheKindOfDevice) {
  const test::TemporaryFolder folder;
  const std::string file = (folder.path() / "device.json").string();
  std::ofstream(file) << pose_text();
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
