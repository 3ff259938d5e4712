// SPDX-License-Identifier: Apache-2.0
#include "formats/session/device_description.h"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

namespace trocar {
namespace {

using Json = nlohmann::json;

std::string shipped_text() {
  std::ifstream file(TROCAR_FOUR_LEGS_JSON);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

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
  const Json document = Json::parse(shipped_text());
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
  const Json document = Json::parse(shipped_text());
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
  Json document = Json::parse(shipped_text());
  EXPECT_EQ(parse_device_description(document.dump(), "d")->plate_stiffness_max_N_per_m, 0);
  document["plate"]["stiffness_max_N_per_m"] = 20'000;
  EXPECT_EQ(parse_device_description(document.dump(), "d")->plate_stiffness_max_N_per_m, 20'000);
  for (const Json& wrong : {Json(0), Json(-5), Json(1e9), Json("stiff")}) {
    document["plate"]["stiffness_max_N_per_m"] = wrong;
    expect_refused(document, "/plate/stiffness_max_N_per_m");
  }
}

TEST(DeviceDescription, RefusesInconsistentValues) {
  const Json document = Json::parse(shipped_text());
  const auto with = [&](const char* pointer, const Json& value) {
    Json changed = document;
    changed[Json::json_pointer(pointer)] = value;
    return changed;
  };
  expect_refused(with("/unknown", 1), "unknown");
  expect_refused(with("/geometry/l6_m", 0.1), "l6_m");
  expect_refused(with("/geometry/l5_m", 0.131), "/geometry/l5_m");
  expect_refused(with("/motors/continuous_torque_Nm", 6.5), "/motors/continuous_torque_Nm");
  expect_refused(with("/joint_limits_deg/theta2", {10, 10}), "/joint_limits_deg/theta2");
  expect_refused(with("/joint_limits_deg/theta2", {0, 361}), "/joint_limits_deg/theta2");
  expect_refused(with("/joint_limits_deg/theta2", {0, 1, 2}), "/joint_limits_deg/theta2");
  expect_refused(with("/plate/inertia_kg_m2", {1, 1, 2.1}), "/plate/inertia_kg_m2");
  expect_refused(with("/simulation/encoder_counts_per_revolution", 1.5), "encoder_counts");
  expect_refused(with("/simulation/encoder_counts_per_revolution", std::uint64_t{1} << 63),
                 "encoder_counts");
  expect_refused(with("/simulation/minimum_substeps", 9), "minimum_substeps");
  expect_refused(with("/branches/theta1", "up"), "/branches/theta1");
  expect_refused(with("/schema", "trocar.device/2"), "/schema");
  expect_refused(with("/assumed", Json{{"/geometry/none", "?"}}), "/assumed");
  expect_refused(with("/assumed", Json{{"no pointer", "?"}}), "/assumed");
  expect_refused(with("/assumed", Json{{"/geometry/d_deg", 3}}), "/assumed");
  expect_refused(with("/assumed", 3), "/assumed");
  expect_refused(Json::array(), "");
  Json other_branch = with("/branches/theta4", "minus");
  const auto mirrored = parse_device_description(other_branch.dump(), "device.json");
  ASSERT_TRUE(mirrored);
  EXPECT_EQ(mirrored->geometry.branch_theta4, -1);
}

TEST(DeviceDescription, RefusesBrokenTextAndFiles) {
  std::string text = shipped_text();
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

}  // namespace
}  // namespace trocar
