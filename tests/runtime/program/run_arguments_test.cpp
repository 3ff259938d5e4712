// SPDX-License-Identifier: Apache-2.0
// What the options of trocar-run set.
#include "runtime/program/run_arguments.h"

#include <gtest/gtest.h>

#include <iterator>
#include <optional>
#include <string>
#include <vector>

namespace trocar::runtime {
namespace {

TEST(RunArguments, ACouplingIsDampedInProportionToItsStiffness) {
  const CouplingOptions usual;
  for (const double factor : {0.01, 0.1, 1.0, 10.0}) {
    RunArguments arguments;
    arguments.coupling_N_per_m = factor * usual.stiffness_N_per_m;
    SessionOptions options;
    set_loop_options(arguments, options);
    EXPECT_TRUE(options.coupling.on);
    EXPECT_EQ(options.coupling.stiffness_N_per_m, *arguments.coupling_N_per_m);
    EXPECT_DOUBLE_EQ(options.coupling.damping_N_s_per_m, factor * usual.damping_N_s_per_m);
  }
  SessionOptions options;
  set_loop_options({}, options);
  EXPECT_FALSE(options.coupling.on);
}

RunArguments with_device(const std::string& device) {
  RunArguments arguments;
  arguments.scene = "scene.json";
  arguments.device = device;
  if (is_device_process(device)) arguments.key_file = "key";
  return arguments;
}

constexpr const char* kProcesses[] = {"udp:127.0.0.1:4840", "pose:127.0.0.1:4840"};
constexpr const char* kWithMotors[] = {"haply:", "haply:127.0.0.1:10001",
                                       "forcedimension:", "forcedimension:1"};

TEST(RunArguments, OnlyADeviceProcessCanBeStatedToHaveNoMotors) {
  for (const char* device : kProcesses) {
    RunArguments arguments = with_device(device);
    arguments.simulated = true;
    EXPECT_TRUE(check_run_arguments(arguments)) << device;
  }
  for (const char* device : kWithMotors) {
    RunArguments arguments = with_device(device);
    EXPECT_TRUE(check_run_arguments(arguments)) << device;
    arguments.simulated = true;
    for (const bool tests : {false, true}) {
      arguments.test_device = tests;
      arguments.scene = tests ? "" : "scene.json";
      const Result<void> checked = check_run_arguments(arguments);
      ASSERT_FALSE(checked) << device;
      EXPECT_EQ(checked.error().code, ExitCode::kUsage);
      EXPECT_NE(checked.error().message.find("--late-ticks-in-row 0"), std::string::npos)
          << checked.error().message;
    }
  }
}

// With motors, a stall of this computer and a leap of the device's clock are faults, whatever the
// options are. Without motors, the leap still is one.
TEST(RunArguments, NoOptionSwitchesALimitOffThatItDoesNotName) {
  const SafetyLimits usual;
  std::vector<std::string> devices{"inproc"};
  devices.insert(devices.end(), std::begin(kProcesses), std::end(kProcesses));
  devices.insert(devices.end(), std::begin(kWithMotors), std::end(kWithMotors));
  for (const std::string& device : devices) {
    for (const std::optional<int> late_ticks : {std::optional<int>(), std::optional<int>(0),
                                                std::optional<int>(1), std::optional<int>(1000)}) {
      for (const bool is_simulated : {false, true}) {
        for (const bool is_virtual : {false, true}) {
          RunArguments arguments = with_device(device);
          arguments.simulated = is_simulated;
          arguments.late_ticks_in_row = late_ticks;
          if (is_virtual) arguments.clock = "virtual";
          arguments.recover = arguments.simulated ? "auto" : "never";
          arguments.passivity = "off";
          arguments.compensate = "both";
          arguments.stiffness_limit_N_per_m = 1e8;
          if (!check_run_arguments(arguments)) continue;
          SessionOptions options;
          set_loop_options(arguments, options);
          const SafetyLimits& limits = options.limits;
          EXPECT_EQ(limits.state_gap_max_s, usual.state_gap_max_s) << device;
          EXPECT_EQ(limits.energy_limit_J, usual.energy_limit_J);
          EXPECT_EQ(limits.speed_max_m_per_s, usual.speed_max_m_per_s);
          EXPECT_EQ(limits.timing.ramp_s, usual.timing.ramp_s);
          const bool ignores_late = is_simulated && late_ticks.value_or(0) == 0;
          EXPECT_EQ(limits.gap_max_s, ignores_late ? 0 : usual.gap_max_s) << device;
          EXPECT_EQ(limits.no_data_max_s,
                    ignores_late && !is_virtual ? kSimulatedNoData_s : usual.no_data_max_s);
          if (!late_ticks && !is_simulated && may_have_motors(device)) {
            EXPECT_EQ(limits.missed_deadlines_max, kDefaultLateTicks - 1);
          }
        }
      }
    }
  }
}

}  // namespace
}  // namespace trocar::runtime
