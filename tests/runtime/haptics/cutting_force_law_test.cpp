// SPDX-License-Identifier: Apache-2.0
// The force law `cutting` without a session, tick by tick.
#include "runtime/haptics/bone/cutting_force_law.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <vector>

#include "runtime/device/four_legs/four_legs.h"
#include "tests/support/body_fixture.h"

namespace trocar::runtime {
namespace {

// A strong layer breaks at 20 N, and the coupling drives the tip through it and 1.6 mm into a weak
// layer, which the tip has not touched before.
TEST(CuttingForceLaw, ALayerThatIsReachedAndPuncturedInOneTickIsReported) {
  Scene scene = test::cutting_scene({0.11});
  SceneLayer strong{.name = "fascia", .top_z_m = 0.12, .thickness_m = 1e-3};
  strong.stiffness_N_per_m = 1e5;
  strong.puncture_N = 20;
  strong.cutting_N = 12;
  SceneLayer weak{.name = "dura", .top_z_m = 0.1185, .thickness_m = 1e-3};
  weak.stiffness_N_per_m = 5000;
  weak.puncture_N = 2;
  weak.cutting_N = 1;
  scene.layers = {strong, weak};
  scene.force_law.axis = ToolAxis::kCoupled;
  scene.force_law.coupling_N_per_m = 4000;
  scene.force_law.coupling_Nm_per_rad = 10;
  scene.force_law.prediction = PosePrediction::kOff;
  scene.force_law.force_scale = 0.1;  // so that the device can render the forces
  const test::Placed placed(scene, test::square_asset(1));
  const FourLegsSpecification device(default_device_description());
  const auto law = CuttingForceLaw::make({scene, device, placed.sheets, 1000, {}, {}});
  ASSERT_TRUE(law) << law.error().message;
  std::vector<std::uint64_t> punctured;
  for (int k = 0; k <= 650; ++k) {
    ForceLawInput input;
    input.sheets = placed.sheets;
    input.T_device_plate.p_m = {0, 0, 0.1205 - 1e-5 * k};
    input.pose_interval_s = 1e-3;
    ContactOutput output;
    ASSERT_EQ((*law)->update(input, output).fault, Fault::kNone);
    if (output.layers_punctured != 0) punctured.push_back(output.layers_punctured);
  }
  EXPECT_EQ(punctured, std::vector<std::uint64_t>{0b11}) << "both in one tick, and only then";
}

// A rigid axis in stiff tissue gives 0.24 J in a tick of 4 ms. Such a session does not start, and the
// rate that is named does.
TEST(CuttingForceLaw, AStiffnessThatIsNotPassiveAtItsRateIsRefusedWithTheRateThatWouldDo) {
  Scene scene = test::cutting_scene({0.12});
  scene.tissue.stiffness_N_per_m = 100'000;
  scene.force_law.axis = ToolAxis::kRigid;
  const test::Placed placed(scene, test::square_asset(1));
  const FourLegsSpecification device(default_device_description());
  const auto make = [&](double rate_Hz) {
    return CuttingForceLaw::make({scene, device, placed.sheets, rate_Hz, {}, {}});
  };
  for (const double rate_Hz : {100.0, 250.0, 500.0}) {
    const auto law = make(rate_Hz);
    ASSERT_FALSE(law) << rate_Hz;
    EXPECT_EQ(law.error().code, ExitCode::kRefused);
    const std::string& why = law.error().message;
    const std::size_t at = why.find("at least ");
    ASSERT_NE(at, std::string::npos) << why;
    const double enough_Hz = std::stod(why.substr(at + 9));
    EXPECT_TRUE(make(enough_Hz)) << why;
    EXPECT_FALSE(make(enough_Hz - 2)) << why;
  }
  scene.tissue.stiffness_N_per_m = 1e8;  // no rate would do
  const test::Placed hard(scene, test::square_asset(1));
  const auto law = CuttingForceLaw::make({scene, device, hard.sheets, 1000, {}, {}});
  ASSERT_FALSE(law);
  EXPECT_EQ(law.error().message.find("Hz,"), std::string::npos) << law.error().message;
  scene.force_law.axis = ToolAxis::kAuto;
  EXPECT_TRUE(CuttingForceLaw::make({scene, device, hard.sheets, 250, {}, {}}));
}

}  // namespace
}  // namespace trocar::runtime
