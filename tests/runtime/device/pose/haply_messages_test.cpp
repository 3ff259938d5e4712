// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/pose/haply.h"

#include <gtest/gtest.h>

#include <bit>
#include <nlohmann/json.hpp>

#include "tests/runtime/device/pose/haply_texts.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;
using Kind = HaplyAnswer::Kind;

TEST(HaplyMessages, InventoriesWithoutDevices) {
  for (const char* const text :
       {"{}", R"({"session_id":3})", R"({"inverse3":[]})", R"({"verse_grip":[]})"}) {
    const auto inventory = parse_haply_inventory(text);
    ASSERT_TRUE(inventory) << text;
    EXPECT_TRUE(inventory->arms.empty() && inventory->grips.empty());
  }
}

TEST(HaplyMessages, ForeignMessagesAreNoInventories) {
  const std::pair<const char*, const char*> cases[] = {
      {"", "it is no valid JSON object"},
      {"hello", "it is no valid JSON object"},
      {"[1,2]", "it is no valid JSON object"},
      {"{\"inverse3\":[]}x", "it is no valid JSON object"},
      {R"({"inverse3":[],"inverse3":[]})", "it is no valid JSON object"},
      {"{\"inverse3\":\"\xff\"}", "it is no valid JSON object"},
      {R"({"devices":[]})", "it has no list of devices"},
      {R"({"inverse3":{}})", "\"inverse3\" is not a list of at most 64 devices"},
      {R"({"inverse3":[1]})", "\"inverse3\" has a device without a valid id"},
      {R"({"inverse3":[{}]})", "\"inverse3\" has a device without a valid id"},
      {R"({"inverse3":[{"device_id":7}]})", "\"inverse3\" has a device without a valid id"},
      {R"({"inverse3":[{"device_id":""}]})", "\"inverse3\" has a device without a valid id"},
      {R"({"inverse3":[{"device_id":"a\"b"}]})", "\"inverse3\" has a device without a valid id"},
      {R"({"inverse3":[{"device_id":"A","state":[]}]})", "\"state\" is not an object"},
      {R"({"inverse3":[{"device_id":"A","config":{"filters":{"force_gate":{"gain":"x"}}}}]})",
       "\"gain\" is not a number"},
      {R"({"inverse3":[{"device_id":"A","status":{"ready":1}}]})",
       "\"ready\" is not true or false"},
  };
  for (const auto& [text, why] : cases) {
    const auto inventory = parse_haply_inventory(text);
    ASSERT_FALSE(inventory) << text;
    EXPECT_EQ(inventory.error().message, why) << text;
  }
  const std::string deep =
      R"({"inverse3":)" + std::string(100'000, '[') + std::string(100'000, ']') + "}";
  EXPECT_FALSE(parse_haply_inventory(deep));
  const std::string long_id(65, 'A');
  EXPECT_FALSE(parse_haply_inventory(R"({"inverse3":[{"device_id":")" + long_id + "\"}]}"));
  const std::string padded = "{}" + std::string(kMaxHaplyMessageBytes - 2, ' ');
  EXPECT_TRUE(parse_haply_inventory(padded));
  EXPECT_FALSE(parse_haply_inventory(padded + ' '));
}

TEST(HaplyMessages, ChangedFramesAreReported) {
  for (const char* const config :
       {R"("preset":"arm_front_centered")", R"("basis":{"permutation":"X-YZ"})",
        R"("mount":{"scale":{"x":2,"y":2,"z":2}})",
        R"("mount":{"position":{"x":0.1,"y":0,"z":0}})"}) {
    const std::string text =
        std::string(R"({"inverse3":[{"device_id":"A","config":{)") + config + "}}]}";
    const auto inventory = parse_haply_inventory(text);
    ASSERT_TRUE(inventory) << text;
    EXPECT_FALSE(inventory->arms[0].has_default_frame) << text;
  }
}

TEST(HaplyMessages, ArmsThatAreNotReady) {
  const std::pair<const char*, const char*> cases[] = {
      {R"("power_supply":false,"ready":false)", "has no power"},
      {R"("ready":false,"calibrated":false)", "is not ready"},
      {R"("ready":true,"calibrated":false)", "is not calibrated"},
      {R"("ready":true,"calibrated":true,"in_use":true,"started":false)", ""},
  };
  for (const auto& [status, problem] : cases) {
    const std::string device = std::string(R"({"device_id":"A","status":{)") + status +
                               R"(},"state":{"cursor_position":{"x":0,"y":0,"z":0}}})";
    const std::string text = "{\"inverse3\":[" + device + "]}";
    const auto inventory = parse_haply_inventory(text);
    ASSERT_TRUE(inventory) << text;
    EXPECT_EQ(inventory->arms[0].problem.substr(0, std::string(problem).size()), problem);
    EXPECT_EQ(inventory->arms[0].problem.empty(), std::string(problem).empty());
    const HaplyAnswer answer = parse_haply_answer(text, {{"inverse3", "A"}, {}});
    EXPECT_EQ(answer.kind, *problem == '\0' ? Kind::kState : Kind::kNotReady) << text;
    if (*problem != '\0') {
      EXPECT_EQ(answer.why.rfind(std::string("device A ") + problem, 0), 0U);
    }
  }
}

TEST(HaplyMessages, StateWithTheWirelessGrip) {
  const HaplyDevices devices{{"inverse3", "049D"}, HaplyDevice{"wireless_verse_grip", "W-7"}};
  const HaplyAnswer answer = parse_haply_answer(kUpdate35, devices);
  ASSERT_EQ(answer.kind, Kind::kState) << answer.why;
  EXPECT_EQ(answer.state.q, (std::array{0.0, 0.0, 0.0, 1.0}));
  EXPECT_EQ(answer.state.buttons, 5U);
  std::string numbered = kUpdate35;
  numbered.replace(numbered.find("\"c\":true"), 8, "\"button_1\":true");
  EXPECT_EQ(parse_haply_answer(numbered, devices).state.buttons, 3U);
}

/// Replaces a value of kUpdate35, which must be there.
std::string changed(const std::string& from, const std::string& to) {
  std::string text = kUpdate35;
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

TEST(HaplyMessages, UnusableStates) {
  const std::string cases[][3] = {
      {"049D", "049E", "it does not list device 049D"},
      {"61548", "61549", "it does not list VerseGrip 61548"},
      {"\"verse_grip\"", "\"other_grip\"", "it does not list VerseGrip 61548"},
      {"0.0125", "\"0.0125\"", "\"x\" is not a number"},
      {"0.0125", "null", "\"x\" is not a number"},
      {"0.0125", "1e400", "it is no valid JSON object"},
      {"0.0125", "NaN", "it is no valid JSON object"},
      {"0.0125", "-10.01", "its position is beyond 10 m"},
      {"\"cursor_position\"", "\"cursor\"", "\"x\" is not a number"},
      {"0.8", "0.81", "its orientation is no unit quaternion"},
      {"0.8", "0", "its orientation is no unit quaternion"},
      {"0.8", "1e200", "its orientation is no unit quaternion"},
      {"0.8", "true", "\"w\" is not a number"},
      {"\"button\":true", "\"button\":1", "\"button\" is not true or false"},
      {"\"ready\":true", "\"ready\":\"yes\"", "\"ready\" is not true or false"},
  };
  const HaplyDevices devices{{"inverse3", "049D"}, HaplyDevice{"verse_grip", "61548"}};
  for (const auto& [from, to, why] : cases) {
    const HaplyAnswer answer = parse_haply_answer(changed(from, to), devices);
    EXPECT_EQ(answer.kind, Kind::kUnusable) << to;
    EXPECT_EQ(answer.why, why) << to;
    const bool lacks_device = why.find("it does not list") == 0;
    EXPECT_EQ(answer.refused.fault, lacks_device ? Fault::kNone : Fault::kRefusedState) << to;
  }
  const FaultDetail far = parse_haply_answer(changed("0.0125", "-10.01"), devices).refused;
  EXPECT_EQ(measured(far), "measured position x -1.001e+04 mm, at least -1e+04 mm");
  const FaultDetail bent = parse_haply_answer(changed("0.8", "0"), devices).refused;
  EXPECT_EQ(bent.quantity, FaultQuantity::kMeasuredRotation);
  EXPECT_EQ(parse_haply_answer("", devices).kind, Kind::kUnusable);
  EXPECT_EQ(parse_haply_answer(changed("0.8", "0.8001"), devices).kind, Kind::kState);
}

TEST(HaplyMessages, AGripThatFallsAsleepIsNotReady) {
  const HaplyDevices devices{{"inverse3", "049D"}, HaplyDevice{"wireless_verse_grip", "W-7"}};
  const HaplyAnswer answer =
      parse_haply_answer(changed("\"awake\":true", "\"awake\":false"), devices);
  EXPECT_EQ(answer.kind, Kind::kNotReady);
  EXPECT_EQ(answer.why, "VerseGrip W-7 is asleep; move it or press a button");
}

TEST(HaplyMessages, ForceInEachSpelling) {
  HaplyDevices devices{{"inverse3", "049D"}, {}, HaplySpelling::kVector};
  EXPECT_EQ(haply_force_message(devices, {0, 1.5, -0.25}),
            R"({"inverse3":[{"device_id":"049D","commands":{"set_cursor_force":)"
            R"({"vector":{"x":0,"y":1.5,"z":-0.25}}}}]})");
  devices.spelling = HaplySpelling::kValues;
  devices.arm.list = "minverse";
  EXPECT_EQ(haply_force_message(devices, {1, 0, 0}),
            R"({"minverse":[{"device_id":"049D","commands":{"set_cursor_force":)"
            R"({"values":{"x":1,"y":0,"z":0}}}}]})");
  devices.spelling = HaplySpelling::kBoth;
  const json both = json::parse(haply_force_message(devices, {1, 2, 3}));
  const json& command = both["minverse"][0]["commands"]["set_cursor_force"];
  EXPECT_EQ(command["values"], command["vector"]);
  EXPECT_EQ(command["values"]["z"], 3);
}

TEST(HaplyMessages, RequestsAnInventory) {
  EXPECT_TRUE(
      json::parse(haply_inventory_request())["session"].contains("force_render_full_state"));
}

}  // namespace
}  // namespace trocar::runtime
