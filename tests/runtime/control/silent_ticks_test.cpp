// SPDX-License-Identifier: Apache-2.0
// Ticks in which the device says nothing: a tool that moves on evenly meanwhile is felt as if all
// had been heard. No rate is taken over one tick where more have passed.
#include <gtest/gtest.h>

#include <functional>
#include <vector>

#include "tests/runtime/control/loop_fixture.h"

namespace trocar::runtime {
namespace {

struct Felt {
  std::vector<double> force_N;  ///< wanted along z, tick by tick
  std::vector<bool> heard;
  std::size_t gave_way = 0;  ///< in this tick
  double judged_N = 0;
};

class SilentTicks : public testing_support::LoopFixture {
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
    state_ = LoopState{};
    Felt felt;
    for (int i = 0; i < 300; ++i) {
      go_to(0.121 - 50e-6 * i);
      const bool silent = is_silent(i);
      device_.on_read = silent ? DeviceStatus::kNoData : DeviceStatus::kOk;
      tick();
      EXPECT_EQ(state_.safety.fault, Fault::kNone) << i << " " << to_word(state_.safety.fault);
      felt.force_N.push_back(result_.row.wrench_wanted[2]);
      felt.heard.push_back(!silent);
      if (!result_.contact.gave_way) continue;
      felt.gave_way = felt.force_N.size() - 1;
      felt.judged_N = result_.contact.judged_force_N;
    }
    return felt;
  }
  Tissue tissue_;
};

TEST_F(SilentTicks, ForcesAreThoseOfTheTicksThatAreHeard) {
  const Felt all = descend([](int) { return false; });
  ASSERT_GT(all.gave_way, 100U);
  ASSERT_NEAR(all.force_N.back(), 1.5, 1e-6) << "the shaft's friction";
  const std::vector<std::function<bool(int)>> patterns = {
      [](int i) { return i > 30 && i % 2 == 0; },
      [](int i) { return i > 30 && i % 9 != 0; },
      [](int i) { return i >= 100 && i < 108; },
      [](int i) { return i >= 190 && i < 198; },
  };
  for (std::size_t p = 0; p < patterns.size(); ++p) {
    const Felt some = descend(patterns[p]);
    EXPECT_GE(some.gave_way, all.gave_way) << p << ": before its force was reached";
    EXPECT_LE(some.gave_way, all.gave_way + 8) << p;
    EXPECT_LE(some.judged_N, all.judged_N + 8 * 5000 * 50e-6 + 1e-6) << p;
    std::size_t same = 0;
    for (std::size_t i = 30; i < all.force_N.size(); ++i) {
      if (i >= all.gave_way && i <= some.gave_way + 9) continue;
      const double expected_N = some.heard[i] ? all.force_N[i] : some.force_N[i - 1];
      ASSERT_NEAR(some.force_N[i], expected_N, 1e-6) << p << ", tick " << i;
      ++same;
    }
    EXPECT_GT(same, 180U);
  }
}

TEST_F(SilentTicks, ACouplingDoesNotTakeThemForABlow) {
  model_.coupling.on = true;
  tissue_.damping_N_s_per_m = 0;
  const Felt all = descend([](int) { return false; });
  const Felt some = descend([](int i) { return i > 30 && i % 9 != 0; });
  ASSERT_GT(all.gave_way, 200U);
  EXPECT_GE(some.gave_way + 1, all.gave_way);
  for (std::size_t i = 60; i < all.gave_way; ++i) {
    const double expected_N = some.heard[i] ? all.force_N[i] : some.force_N[i - 1];
    ASSERT_NEAR(some.force_N[i], expected_N, 1e-3) << "tick " << i;
  }
}

TEST_F(SilentTicks, SpeedIsKeptOverThem) {
  const auto twist_after = [&](int silent) {
    descend([&](int i) { return i >= 299 - silent && i < 299; });
    return state_.limits.twist_device;
  };
  for (const int silent : {1, 4, 8}) {
    descend([&](int i) { return i >= 300 - silent; });
    EXPECT_NEAR(state_.limits.twist_device[2], -0.05, 1e-4) << silent;
    EXPECT_NEAR(twist_after(silent)[2], -0.05, 1e-4) << silent;
  }
}

}  // namespace
}  // namespace trocar::runtime
