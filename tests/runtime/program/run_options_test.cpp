// SPDX-License-Identifier: Apache-2.0
// What the options of trocar-run set.
#include "runtime/program/run_options.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "formats/base/command_line.h"

namespace trocar::runtime {
namespace {

/// The session's options of `trocar-run scene.json WORDS`. Errors: those of parse() and
/// check_options().
Result<SessionOptions> options_of(std::vector<std::string> words) {
  CLI::App app;
  RunArguments arguments;
  declare_run(app, arguments);
  words.insert(words.begin(), {kProgram, "scene.json"});
  if (const auto good = parse(app, words); !good) return good.error();
  if (const auto good = check_options(arguments); !good) return good.error();
  return session_options(arguments);
}

std::vector<std::string> with_device(const std::string& device) {
  std::vector<std::string> words{"--device", device};
  if (is_device_process(device)) words.insert(words.end(), {"--key-file", "key"});
  return words;
}

constexpr const char* kProcesses[] = {"udp:127.0.0.1:4840", "pose:127.0.0.1:4840"};
constexpr const char* kWithMotors[] = {"haply:", "haply:127.0.0.1:10001",
                                       "forcedimension:", "forcedimension:1"};

TEST(RunOptions, ACouplingIsDampedInProportionToItsStiffness) {
  const CouplingOptions usual;
  for (const double stiffness_N_per_m : {100.0, 1e3, 1e5}) {
    const auto options = options_of({"--coupling", std::to_string(stiffness_N_per_m)});
    ASSERT_TRUE(options) << options.error().message;
    EXPECT_TRUE(options->coupling.on);
    EXPECT_EQ(options->coupling.stiffness_N_per_m, stiffness_N_per_m);
    EXPECT_DOUBLE_EQ(options->coupling.damping_N_s_per_m / usual.damping_N_s_per_m,
                     stiffness_N_per_m / usual.stiffness_N_per_m);
  }
  EXPECT_FALSE(options_of({})->coupling.on);
}

TEST(RunOptions, AreThoseOfTheSession) {
  const auto options = options_of(
      {"--clock",      "virtual", "--recover",      "signal", "--passivity",       "off",
       "--compensate", "weight",  "--energy-limit", "0.2",    "--stiffness-limit", "500",
       "--cpu",        "0",       "--record",       "r.csv",  "--black-box",       "boxes",
       "--live",       "link",    "--xray"});
  ASSERT_TRUE(options) << options.error().message;
  EXPECT_EQ(options->clock, Clock::kVirtual);
  EXPECT_EQ(options->recovery, RecoveryPolicy::kOnRequest);
  EXPECT_FALSE(options->guards || options->compensation.friction);
  EXPECT_TRUE(options->compensation.gravity && options->counts_xray);
  EXPECT_EQ(options->limits.energy_limit_J, 0.2);
  EXPECT_EQ(options->stiffness.max_N_per_m, 500);
  EXPECT_EQ(options->cpu, 0);
  EXPECT_TRUE(options->record == "r.csv" && options->black_box == "boxes");
  EXPECT_FALSE(options_of({})->record || options_of({})->black_box);
}

TEST(RunOptions, OnlyADeviceProcessCanBeStatedToHaveNoMotors) {
  for (const char* device : kProcesses) {
    std::vector<std::string> words = with_device(device);
    words.emplace_back("--simulated");
    EXPECT_TRUE(options_of(words)) << device;
  }
  for (const char* device : kWithMotors) {
    std::vector<std::string> words = with_device(device);
    EXPECT_TRUE(options_of(words)) << device;
    words.emplace_back("--simulated");
    const auto refused = options_of(words);
    ASSERT_FALSE(refused) << device;
    EXPECT_EQ(refused.error().code, ExitCode::kUsage);
    EXPECT_NE(refused.error().message.find("--late-ticks-in-row 0"), std::string::npos)
        << refused.error().message;
  }
}

// With motors, a stall of this computer and a leap of the device's clock are faults, whatever the
// options are. Without motors, the leap still is one.
TEST(RunOptions, NoOptionSwitchesALimitOffThatItDoesNotName) {
  const SafetyLimits usual;
  std::vector<std::string> devices{"inproc"};
  devices.insert(devices.end(), std::begin(kProcesses), std::end(kProcesses));
  devices.insert(devices.end(), std::begin(kWithMotors), std::end(kWithMotors));
  int accepted = 0;
  for (const std::string& device : devices) {
    for (const char* late_ticks : {"", "0", "1", "1000"}) {
      for (const bool is_simulated : {false, true}) {
        for (const bool is_virtual : {false, true}) {
          std::vector<std::string> words = with_device(device);
          if (is_simulated) words.emplace_back("--simulated");
          if (*late_ticks != '\0') words.insert(words.end(), {"--late-ticks-in-row", late_ticks});
          words.insert(words.end(), {"--clock", is_virtual ? "virtual" : "real", "--recover",
                                     is_simulated ? "auto" : "never", "--passivity", "off",
                                     "--compensate", "both", "--stiffness-limit", "100000000"});
          const auto options = options_of(words);
          if (!options) continue;
          ++accepted;
          const SafetyLimits& limits = options->limits;
          EXPECT_EQ(limits.state_gap_max_s, usual.state_gap_max_s) << device;
          EXPECT_EQ(limits.energy_limit_J, usual.energy_limit_J);
          EXPECT_EQ(limits.speed_max_m_per_s, usual.speed_max_m_per_s);
          EXPECT_EQ(limits.timing.ramp_s, usual.timing.ramp_s);
          const bool ignores_late =
              is_simulated && (*late_ticks == '\0' || std::string(late_ticks) == "0");
          EXPECT_EQ(limits.gap_max_s, ignores_late ? 0 : usual.gap_max_s) << device;
          EXPECT_EQ(limits.no_data_max_s,
                    ignores_late && !is_virtual ? kSimulatedNoData_s : usual.no_data_max_s);
          if (*late_ticks == '\0' && !is_simulated && may_have_motors(device)) {
            EXPECT_EQ(limits.missed_deadlines_max, kDefaultLateTicks - 1);
          }
        }
      }
    }
  }
  EXPECT_EQ(accepted, 7 * 8 + 2 * 8);  // with --simulated, only the device processes
}

}  // namespace
}  // namespace trocar::runtime
