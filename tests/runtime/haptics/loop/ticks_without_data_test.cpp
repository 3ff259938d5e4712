// SPDX-License-Identifier: Apache-2.0
// Ticks without data from the device while the tool moves on steadily: forces in the ticks with
// data are the same as if no data were missing. Velocities are taken over the time since the last
// data.
#include <gtest/gtest.h>

#include <functional>
#include <vector>

#include "tests/runtime/haptics/loop/loop_fixture.h"

namespace trocar::runtime {
namespace {

struct Felt {
  std::vector<double> force_N;  ///< wanted along z, tick by tick
  std::vector<bool> has_data;
  std::size_t punctured = 0;  ///< tick of the puncture
  double puncture_N = 0;
};

class TicksWithoutData : public testing_support::LoopFixture {
 protected:
  void SetUp() override {
    LoopFixture::SetUp();
    tissue_.damping_N_s_per_m = 40;
    tissue_.shaft.viscous_friction_N_s_per_m = 30;
  }
  /// Down at 50 mm/s through the sheet, from 1 mm above it.
  Felt descend(const std::function<bool(int)>& is_silent) {
    auto sheet = std::make_unique<Sheet>(*sheets_[0]);
    sheet->tissue = tissue_;
    current_ = {sheet.get()};
    restart();
    Felt felt;
    for (int i = 0; i < 300; ++i) {
      go_to(0.121 - 50e-6 * i);
      const bool silent = is_silent(i);
      device_.on_read = silent ? DeviceStatus::kNoData : DeviceStatus::kOk;
      tick();
      EXPECT_EQ(state_.safety.fault, Fault::kNone) << i << " " << to_string(state_.safety.fault);
      felt.force_N.push_back(result_.row.wrench_wanted[2]);
      felt.has_data.push_back(!silent);
      if (!result_.contact.punctured_now) continue;
      felt.punctured = felt.force_N.size() - 1;
      felt.puncture_N = result_.contact.trial_force_N;
    }
    return felt;
  }
  Tissue tissue_;
};

TEST_F(TicksWithoutData, ForcesEqualThoseOfARunWithAllData) {
  const Felt all = descend([](int) { return false; });
  ASSERT_GT(all.punctured, 100U);
  ASSERT_NEAR(all.force_N.back(), 1.5, 1e-6) << "the shaft's friction";
  const std::vector<std::function<bool(int)>> patterns = {
      [](int i) { return i > 30 && i % 2 == 0; },
      [](int i) { return i > 30 && i % 9 != 0; },
      [](int i) { return i >= 100 && i < 108; },
      [](int i) { return i >= 190 && i < 198; },
  };
  for (std::size_t p = 0; p < patterns.size(); ++p) {
    const Felt some = descend(patterns[p]);
    EXPECT_GE(some.punctured, all.punctured) << p << ": before the threshold was reached";
    EXPECT_LE(some.punctured, all.punctured + 8) << p;
    EXPECT_LE(some.puncture_N, all.puncture_N + 8 * 5000 * 50e-6 + 1e-6) << p;
    std::size_t same = 0;
    for (std::size_t i = 30; i < all.force_N.size(); ++i) {
      if (i >= all.punctured && i <= some.punctured + 9) continue;
      const double expected_N = some.has_data[i] ? all.force_N[i] : some.force_N[i - 1];
      ASSERT_NEAR(some.force_N[i], expected_N, 1e-6) << p << ", tick " << i;
      ++same;
    }
    EXPECT_GT(same, 180U);
  }
}

TEST_F(TicksWithoutData, ACouplingHasNoForceSpikeAfterThem) {
  law_.coupling_options().on = true;
  tissue_.damping_N_s_per_m = 0;
  const Felt all = descend([](int) { return false; });
  const Felt some = descend([](int i) { return i > 30 && i % 9 != 0; });
  ASSERT_GT(all.punctured, 200U);
  EXPECT_GE(some.punctured + 1, all.punctured);
  for (std::size_t i = 60; i < all.punctured; ++i) {
    const double expected_N = some.has_data[i] ? all.force_N[i] : some.force_N[i - 1];
    ASSERT_NEAR(some.force_N[i], expected_N, 1e-3) << "tick " << i;
  }
}

TEST_F(TicksWithoutData, SpeedIsHeldOverThem) {
  const auto twist_after = [&](int silent) {
    descend([&](int i) { return i >= 299 - silent && i < 299; });
    return state_.speed.twist_device;
  };
  for (const int silent : {1, 4, 8}) {
    descend([&](int i) { return i >= 300 - silent; });
    EXPECT_NEAR(state_.speed.twist_device[2], -0.05, 1e-4) << silent;
    EXPECT_NEAR(twist_after(silent)[2], -0.05, 1e-4) << silent;
  }
}

// Loop and device both run at 100 Hz: now and then a tick finds no new state, and one may be lost.
TEST_F(TicksWithoutData, AtALowRateThreeInARowAreAFault) {
  model_.rate_Hz = 100;
  restart();
  go_to(0.125);
  for (int i = 0; i < 5; ++i)
    tick();
  ASSERT_EQ(state_.safety.state, SafetyState::kRunning);
  device_.on_read = DeviceStatus::kNoData;
  for (int i = 0; i < 2; ++i) {
    tick();
    EXPECT_EQ(state_.safety.fault, Fault::kNone) << i;
  }
  tick();
  EXPECT_EQ(state_.safety.fault, Fault::kNoData);
  EXPECT_EQ(result_.found.limit, 0.03);
}

}  // namespace
}  // namespace trocar::runtime
