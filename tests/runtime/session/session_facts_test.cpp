// SPDX-License-Identifier: Apache-2.0
// The facts of the device in a session's telemetry.
#include "runtime/session/session_publisher.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "runtime/device/four_legs/four_legs.h"
#include "runtime/session/session_options.h"
#include "tests/support/handle_device.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;

json facts_of(const DeviceSpecification& device) {
  const Remesher no_sheets(std::vector<std::unique_ptr<const Sheet>>{});
  SessionOptions session;
  session.telemetry.emplace();
  session.limits.workspace_min_m = {-1, -2, 3};
  return json::parse(session_facts({}, device, no_sheets, session));
}

TEST(SessionFacts, HaveTheMotorsAndJointsOfADeviceThatHasThem) {
  const DeviceDescription description = default_device_description();
  const json legs = facts_of(FourLegsSpecification(description));
  EXPECT_EQ(legs["motor_peak_torque_Nm"], description.motor_peak_torque_Nm);
  EXPECT_EQ(legs["motor_continuous_torque_Nm"], description.motor_continuous_torque_Nm);
  ASSERT_EQ(legs["joint_limits_rad"].size(), std::size_t{kJointsPerLeg});
  EXPECT_EQ(legs["joint_limits_rad"][3],
            json({description.joint_limit[3].min_rad, description.joint_limit[3].max_rad}));

  const json handle = facts_of(test::HandleSpecification(5));
  EXPECT_TRUE(handle.at("motor_peak_torque_Nm").is_null());
  EXPECT_TRUE(handle.at("motor_continuous_torque_Nm").is_null());
  EXPECT_EQ(handle.at("joint_limits_rad"), json::array());
  EXPECT_EQ(handle["workspace"]["min_m"], json({-1, -2, 3}));
}

}  // namespace
}  // namespace trocar::runtime
