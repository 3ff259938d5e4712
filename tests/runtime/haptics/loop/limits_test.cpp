// SPDX-License-Identifier: Apache-2.0
// Each limit: kNone within it, its fault beyond it.
#include "runtime/haptics/loop/safety.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <utility>

#include "tests/support/uniform.h"

namespace trocar::runtime {
namespace {

using trocar::test::uniform;

TEST(Limits, WorkspaceIsABoxAndATilt) {
  const SafetyLimits limits;
  std::mt19937_64 random(3);
  int inside = 0, outside = 0;
  for (int i = 0; i < 20000; ++i) {
    Pose pose;
    pose.p_m = {0.16 * uniform(random) - 0.08, 0.16 * uniform(random) - 0.08,
                0.26 * uniform(random)};
    const double tilt_rad = uniform(random);
    const double azimuth_rad = 6 * uniform(random);
    pose.q = from_rotation_vector(tilt_rad *
                                  Eigen::Vector3d(std::cos(azimuth_rad), std::sin(azimuth_rad), 0));
    const bool good = std::abs(pose.p_m.x()) <= 0.06 && std::abs(pose.p_m.y()) <= 0.06 &&
                      pose.p_m.z() >= 0.06 && pose.p_m.z() <= 0.24 && tilt_rad <= 0.6;
    ASSERT_EQ(check_workspace(limits, pose), good ? Fault::kNone : Fault::kWorkspace);
    ++(good ? inside : outside);
  }
  EXPECT_GT(inside, 1000);
  EXPECT_GT(outside, 1000);
  Pose broken;
  broken.p_m = {0, NAN, 0.1};
  EXPECT_EQ(check_workspace(limits, broken), Fault::kWorkspace);
  broken.p_m.y() = 0;
  broken.q.x() = NAN;
  EXPECT_EQ(check_workspace(limits, broken), Fault::kWorkspace);
}

TEST(Limits, SpeedIsDetectedAtEveryRateAndOneCountIsNotASpeed) {
  const SafetyLimits limits;
  for (const double rate_Hz : {500.0, 1000.0, 8000.0}) {
    for (const double turns : {0.0, 1.0}) {
      const double most = turns > 0 ? limits.rotation_rate_max_rad_per_s : limits.speed_max_m_per_s;
      const auto at = [&](double way) {
        Pose pose;
        if (turns > 0) {
          pose.q = from_rotation_vector({0, way, 0});
        } else {
          pose.p_m.x() = way;
        }
        return pose;
      };
      for (const double share : {0.98, 1.1}) {
        SpeedState state;
        double seen_s = -1;
        for (int k = 0; k * 1.0 < 0.05 * rate_Hz; ++k) {
          const double t_s = k / rate_Hz;
          if (check_speed(limits, at(share * most * t_s), 1 / rate_Hz, state) != Fault::kNone) {
            seen_s = t_s;
            break;
          }
        }
        if (share < 1) {
          EXPECT_EQ(seen_s, -1) << rate_Hz;
        } else {  // ln(11) time constants
          EXPECT_GT(seen_s, 0) << rate_Hz;
          EXPECT_LT(seen_s, 3.2 * limits.speed_window_s + 2 / rate_Hz) << rate_Hz;
        }
      }
    }
    // Forth and back by 0.1 mm every tick: 0.8 m/s at 8 kHz from tick to tick.
    SpeedState state;
    for (int k = 0; k < 1000; ++k) {
      Pose pose;
      pose.p_m.x() = k % 2 == 0 ? 0 : 1e-4;
      ASSERT_EQ(check_speed(limits, pose, 1 / rate_Hz, state), Fault::kNone);
    }
  }
  SpeedState state;
  Pose broken;
  check_speed(limits, broken, 1e-3, state);
  broken.p_m.x() = NAN;
  EXPECT_EQ(check_speed(limits, broken, 1e-3, state), Fault::kSpeed);
  check_speed(limits, Pose{}, 1e-3, state);
  EXPECT_EQ(check_speed(limits, Pose{}, 1e-3, state), Fault::kNone)
      << "no longer, with a finite pose";
}

// Item 1, at rest: limits of nan, and negative limits.
TEST(Limits, ALimitOfNanOrANegativeLimitAlwaysTrips) {
  const auto found = [](const SafetyLimits& limits) -> Fault {
    SpeedState state;
    Pose at;
    at.p_m.z() = 0.15;
    if (const Fault f = check_workspace(limits, at); f != Fault::kNone) return f;
    return check_speed(limits, at, 1e-3, state);
  };
  ASSERT_EQ(found({}), Fault::kNone);
  using Limit = double SafetyLimits::*;
  for (const auto& [limit, fault] :
       {std::pair<Limit, Fault>{&SafetyLimits::plate_tilt_max_rad, Fault::kWorkspace},
        {&SafetyLimits::speed_max_m_per_s, Fault::kSpeed},
        {&SafetyLimits::rotation_rate_max_rad_per_s, Fault::kSpeed},
        {&SafetyLimits::speed_window_s, Fault::kSpeed}}) {
    for (const double bad : {static_cast<double>(NAN), -0.1, -static_cast<double>(INFINITY)}) {
      SafetyLimits limits;
      limits.*limit = bad;
      EXPECT_EQ(found(limits), fault) << to_string(fault) << " at " << bad;
    }
  }
}

}  // namespace
}  // namespace trocar::runtime
