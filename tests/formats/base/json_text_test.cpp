// SPDX-License-Identifier: Apache-2.0
#include "formats/base/json.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <fstream>
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

TEST(JsonText, TextThatIsNoJsonIsDiscardedUnlessItIsKnownToBeJson) {
  const std::string wrong = "{\"a\":";
  const std::vector<std::uint8_t> bytes{'{', '"', 'a', '"', ':', '1', '}'};
  EXPECT_TRUE(parse_json(wrong).is_discarded());
  EXPECT_TRUE(parse_json(std::vector<std::uint8_t>{}).is_discarded());
  EXPECT_EQ(parse_json(bytes), parse_json(R"({"a":1})"));
  EXPECT_EQ(parse_known_json(R"({"a":1})").at("a"), 1);
  EXPECT_THROW(parse_known_json(wrong), nlohmann::json::exception);
}

std::string repeated(const std::string& text, std::size_t times) {
  std::string out;
  for (std::size_t i = 0; i < times; ++i)
    out += text;
  return out;
}

/// Largest resident memory of this process since the last call of forget_peak(), kB.
std::size_t peak_kB() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;) {
    std::size_t kB = 0;
    if (word == "VmHWM:" && status >> kB) return kB;
  }
  return 0;
}
void forget_peak() {
  std::ofstream("/proc/self/clear_refs") << 5;
}

TEST(JsonText, ParsingEndsWhereTextIsNestedTooDeeply) {
  constexpr std::size_t kBytes = std::size_t{4} << 20, kMost_kB = std::size_t{16} << 10;
  for (const std::string open : {"[", "{\"a\":", "[{\"\\\"[\":"}) {
    const std::string text = "{\"schema\": " + repeated(open, kBytes / open.size());
    forget_peak();
    const std::size_t before_kB = peak_kB();
    EXPECT_TRUE(parse_json(text).is_discarded());
    const auto strict = parse_strict_json(text, "f");
    ASSERT_FALSE(strict);
    EXPECT_EQ(strict.error().message, "f: nested too deeply");
    EXPECT_LT(peak_kB() - before_kB, kMost_kB) << open;
  }
}

TEST(JsonText, TheLargestDepthIsParsed) {
  for (const auto& [open, close] :
       {std::pair<std::string, std::string>{"[", "]"}, {"{\"[\\\"[\":", "}"}}) {
    const auto nested = [&open = open, &close = close](std::size_t depth) {
      return repeated(open, depth) + "1" + repeated(close, depth);
    };
    EXPECT_FALSE(parse_json(nested(kMaxJsonDepth)).is_discarded());
    EXPECT_TRUE(parse_strict_json(nested(kMaxJsonDepth), "f"));
    EXPECT_TRUE(parse_json(nested(kMaxJsonDepth + 1)).is_discarded());
    EXPECT_FALSE(parse_strict_json(nested(kMaxJsonDepth + 1), "f"));
    const std::string many = "[" + repeated(nested(kMaxJsonDepth - 1) + ",", 100) + "1]";
    EXPECT_FALSE(parse_json(many).is_discarded()) << "depth is not number";
  }
}

}  // namespace
}  // namespace trocar
