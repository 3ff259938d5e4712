// SPDX-License-Identifier: Apache-2.0
#include "formats/base/json_text.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <vector>

namespace trocar {
namespace {

TEST(JsonText, AnOrderedValueKeepsTheOrderOfItsKeys) {
  const nlohmann::ordered_json ordered{{"z", {{"b", 1}, {"a", 2}}}, {"m", 3}};
  EXPECT_EQ(json_text(ordered), R"({"z":{"b":1,"a":2},"m":3})");
  EXPECT_EQ(json_text(nlohmann::json(ordered)), R"({"m":3,"z":{"a":2,"b":1}})");
  EXPECT_EQ(json_text(nlohmann::ordered_json{{"a", "\xff"}}, 1), "{\n \"a\": \"\uFFFD\"\n}");
}

TEST(JsonText, OtherTypesAreWrittenAsJson) {
  EXPECT_EQ(json_text(0.5), "0.5");
  EXPECT_EQ(json_text(std::string("a\xff\"")), "\"a\uFFFD\\\"\"");
  EXPECT_EQ(json_text(nlohmann::json::array({1, nullptr})), "[1,null]");
}

TEST(JsonText, TextThatIsNoJsonIsDiscardedUnlessItIsKnownToBeJson) {
  const std::string wrong = "{\"a\":";
  const std::vector<std::uint8_t> bytes{'{', '"', 'a', '"', ':', '1', '}'};
  EXPECT_TRUE(parse_json(wrong).is_discarded());
  EXPECT_TRUE(parse_json(std::vector<std::uint8_t>{}).is_discarded());
  EXPECT_EQ(parse_json(bytes), parse_json(R"({"a":1})"));
  EXPECT_EQ(parse_known_json(R"({"a":1})").at("a"), 1);
  EXPECT_THROW(parse_known_json(wrong), nlohmann::json::exception);
}

}  // namespace
}  // namespace trocar
