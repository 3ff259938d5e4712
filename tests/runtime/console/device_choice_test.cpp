// SPDX-License-Identifier: Apache-2.0
// The devices of trocar-console --device, and what pages do not see of them.
#include "runtime/console/device_test.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace trocar::runtime {
namespace {

TEST(DeviceChoice, UriWithOptionsInAnyOrder) {
  const auto plain = parse_device_choice("haply:");
  ASSERT_TRUE(plain);
  EXPECT_EQ(plain->name, "haply:");
  EXPECT_TRUE(plain->words.empty());
  EXPECT_FALSE(plain->is_simulated());
  const auto full =
      parse_device_choice("udp:[::1]:4840,simulated,key-file=/a=b/k,device-description=d.json");
  ASSERT_TRUE(full);
  EXPECT_EQ(full->name, "udp:[::1]:4840");
  EXPECT_EQ(full->words, (std::vector<std::string>{"--simulated", "--key-file", "/a=b/k",
                                                   "--device-description", "d.json"}));
  EXPECT_TRUE(full->is_simulated() && full->can_be_tested());
  const auto limited = parse_device_choice("haply:,force-limit=3,force-scale=0.2");
  ASSERT_TRUE(limited);
  EXPECT_EQ(limited->words,
            (std::vector<std::string>{"--force-limit", "3", "--force-scale", "0.2"}));
  for (const char* own : {"inproc", "sim"}) {
    const auto simulated = parse_device_choice(own);
    EXPECT_TRUE(simulated && simulated->is_simulated() && !simulated->can_be_tested()) << own;
  }
}

TEST(DeviceChoice, RefusesOtherOptions) {
  for (const char* wrong :
       {"udp:a:1,", "udp:a:1,,simulated", "udp:a:1,key-file", "udp:a:1,key-file=",
        "haply:,force-limit", "haply:,force-limit=", "udp:a:1,simulated=", "udp:a:1,simulated=1",
        "udp:a:1,Simulated", "udp:a:1,--live=x", "udp:a:1,late-ticks-in-row=0",
        "udp:a:1, simulated", "udp:a:1,simulated,simulated", "udp:a:1,key-file=x,key-file=x"}) {
    const auto choice = parse_device_choice(wrong);
    ASSERT_FALSE(choice) << wrong;
    EXPECT_EQ(choice.error().code, ExitCode::kUsage);
    EXPECT_EQ(choice.error().message.find('\n'), std::string::npos);
  }
}

TEST(HiddenTexts, ReplacesTheLongestFirst) {
  HiddenTexts hidden;
  hidden.add("/data/", "");
  hidden.add("/data/sessions/", "sessions/");
  hidden.add("", "nothing");
  const auto device = parse_device_choice("udp:a:1,simulated,key-file=/data/secret.key");
  ASSERT_TRUE(device);
  hidden.add(*device);
  EXPECT_EQ(hidden.hide("/data/sessions/1/log, /data/a.json, /data/secret.key: no"),
            "sessions/1/log, a.json, the file of key-file: no");
  EXPECT_EQ(hidden.hide("nothing to hide"), "nothing to hide");
}

TEST(HiddenTexts, KeepsNamesWithoutFolder) {
  HiddenTexts hidden;
  const auto device = parse_device_choice("udp:a:1,key-file=k");
  ASSERT_TRUE(device);
  hidden.add(*device);
  EXPECT_EQ(hidden.hide("k is kept"), "k is kept");
}

}  // namespace
}  // namespace trocar::runtime
