// SPDX-License-Identifier: Apache-2.0
// The safety state machine: its table against a second formulation, its contract under random events; and
// each limit: kNone within it, its fault beyond it.
#include "runtime/haptics/loop/safety.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <utility>

#include "tests/support/uniform.h"

namespace trocar::runtime {
namespace {

using trocar::test::uniform;

// The safety state machine: its table against a second formulation, and its contract under random
// events.

using S = SafetyState;
using E = SafetyEvent;

TEST(SafetyTable, EveryEventInEveryState) {
  for (int s = 0; s < kSafetyStates; ++s) {
    for (int e = 0; e < kSafetyEvents; ++e) {
      const auto state = static_cast<S>(s);
      const auto event = static_cast<E>(e);
      S expected = state;
      if (event == E::kFault && state != S::kRecovering) expected = S::kFault;
      if (event == E::kStop) expected = S::kFault;
      if (state == S::kIdle && event == E::kSeen) expected = S::kReady;
      if (state == S::kReady && event == E::kFree) expected = S::kRunning;
      if (state == S::kFault && event == E::kRecover) expected = S::kRecovering;
      if (state == S::kRecovering && event == E::kSettled) expected = S::kReady;
      EXPECT_EQ(next_state(state, event), expected) << to_string(state) << " " << e;
    }
  }
}

TEST(Safety, EveryRampReachesZeroWithinFiveMilliseconds) {
  const SafetyTiming timing;
  for (int hertz = 200; hertz <= 8000; ++hertz) {
    const double rate_Hz = hertz;
    const int ticks = ramp_ticks(timing, rate_Hz);
    ASSERT_GE(ticks, 1);
    // The fault is at worst right after a tick, and found in the next; if that tick's own write
    // failed, the ramp begins one later.
    ASSERT_LE((1 + ticks - 1) / rate_Hz, 0.005 + 1e-12) << rate_Hz;
    ASSERT_LE(ticks / rate_Hz, rate_Hz < 250 ? 0.005 : 0.004 + 1e-9) << rate_Hz;
    Safety safety;
    safety.state = S::kRunning;
    ASSERT_TRUE(raise(safety, Fault::kSpeed, 1));
    double last = 1;
    for (int i = 1; i <= ticks; ++i) {
      ASSERT_FALSE(torques_are_zero(safety, timing, rate_Hz));
      const double factor = ramp_factor(safety, timing, rate_Hz);
      ASSERT_NEAR(factor, 1 - static_cast<double>(i) / ticks, 1e-12);
      ASSERT_LT(factor, last);
      last = factor;
    }
    ASSERT_EQ(last, 0);
    ASSERT_TRUE(torques_are_zero(safety, timing, rate_Hz));
    ASSERT_EQ(ramp_factor(safety, timing, rate_Hz), 0);
  }
  EXPECT_EQ(ramp_ticks(timing, 500), 2);
  EXPECT_EQ(ramp_ticks(timing, 1000), 4);
  EXPECT_EQ(ramp_ticks(timing, 8000), 32);
  EXPECT_EQ(ramp_ticks(timing, 100), 1) << "at once";
  SafetyTiming none;
  none.ramp_s = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(ramp_ticks(none, 1000), 1) << "nan: at once";
  SafetyTiming slow;
  slow.ramp_s = 1;
  EXPECT_EQ(ramp_ticks(slow, 1000), 4);
}

TEST(Safety, AfterEnergyTorquesAreZeroAtOnceAndStayZero) {
  const SafetyTiming timing{0.004, 0, 0};  // `recovering` ends in its first tick
  Safety safety;
  safety.state = S::kRunning;
  ASSERT_TRUE(raise(safety, Fault::kEnergyLimit, 1));
  EXPECT_EQ(ramp_factor(safety, timing, 8000), 0);
  EXPECT_TRUE(torques_are_zero(safety, timing, 8000));
  answer_request(safety, RecoveryRequest::kByOperator, timing, 8000);
  ASSERT_EQ(safety.state, S::kRecovering);
  for (int i = 0; i < 5; ++i) {
    advance(safety, timing, 8000, Fault::kNone, 1, true, false);
    EXPECT_EQ(safety.state, S::kReady);
    EXPECT_EQ(ramp_factor(safety, timing, 8000), 0) << "no rest of a ramp";
  }
}

TEST(Safety, ATimeOfNanIsSafe) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN(), kRate_Hz = 1000;
  const auto ready_after = [&](double quiet_s) {
    const SafetyTiming timing{0.004, quiet_s, 0.01};
    Safety safety;
    safety.state = S::kRecovering;
    int ticks = 0;
    while (safety.state == S::kRecovering && ticks < 1000) {
      advance(safety, timing, kRate_Hz, Fault::kNone, 0, true, true);
      ++ticks;
    }
    return safety.state == S::kReady ? ticks : -1;
  };
  EXPECT_EQ(ready_after(0.02), 20);
  EXPECT_EQ(ready_after(0), 1);
  EXPECT_EQ(ready_after(-1), 1);
  EXPECT_EQ(ready_after(kNan), -1);
  EXPECT_EQ(ready_after(std::numeric_limits<double>::infinity()), -1);
  const auto rise = [&](double ramp_up_s) { return rise_per_tick({0, 0, ramp_up_s}, kRate_Hz); };
  EXPECT_EQ(rise(0.25), 1 / 250.0);
  EXPECT_EQ(rise(0), 1);
  EXPECT_EQ(rise(-1), 1);
  EXPECT_EQ(rise(kNan), 0);
  EXPECT_EQ(rise(std::numeric_limits<double>::infinity()), 0);
}

TEST(Safety, AStopIsLatchedInEveryStateAndReplacesTheFault) {
  for (const S state : {S::kIdle, S::kReady, S::kRunning, S::kFault, S::kRecovering}) {
    for (const bool by_device : {false, true}) {
      Safety safety;
      safety.state = state;
      if (state == S::kFault || state == S::kRecovering) safety.fault = Fault::kEncoderJump;
      const auto press = [&](bool is_pressed) {
        const DeviceStatus read =
            by_device && is_pressed ? DeviceStatus::kEmergencyStop : DeviceStatus::kOk;
        take_stops(safety, read, !by_device && is_pressed ? Fault::kEmergencyStop : Fault::kNone,
                   2);
      };
      for (const std::uint64_t presses : {1U, 2U}) {
        press(true);
        press(true);
        EXPECT_EQ(safety.state, S::kFault);
        EXPECT_EQ(safety.fault, Fault::kEmergencyStop);
        EXPECT_EQ(safety.fault_t_s, 2);
        EXPECT_EQ(safety.faults, presses);
        press(false);
      }
    }
  }
}

TEST(Safety, ASilentLinkReleasesNoStop) {
  const SafetyTiming timing;
  Safety safety;
  take_stops(safety, DeviceStatus::kEmergencyStop, Fault::kNone, 0);
  safety.ramp_ticks_done = 100;
  const auto ask = [&](DeviceStatus read) {
    take_stops(safety, read, Fault::kNone, 1);
    return answer_request(safety, RecoveryRequest::kByOperator, timing, 1000);
  };
  for (const DeviceStatus silent : {DeviceStatus::kNoData, DeviceStatus::kLinkLost})
    for (int i = 0; i < 100; ++i)
      ASSERT_EQ(ask(silent), RecoveryAnswer::kRefused);
  EXPECT_EQ(ask(DeviceStatus::kMotorFault), RecoveryAnswer::kRefused) << "just released";
  EXPECT_EQ(safety.state, S::kFault);
  EXPECT_EQ(ask(DeviceStatus::kOk), RecoveryAnswer::kTaken);
  EXPECT_EQ(safety.state, S::kRecovering);
  EXPECT_EQ(safety.faults, 1U);
}

TEST(Safety, ARequestInTheRampWaitsForItsEndUnlessAStopComes) {
  const SafetyTiming timing;
  for (const bool is_stopped : {false, true}) {
    Safety safety;
    safety.state = S::kRunning;
    raise(safety, Fault::kSpeed, 0);
    ramp_factor(safety, timing, 1000);
    answer_request(safety, RecoveryRequest::kByOperator, timing, 1000);
    ASSERT_EQ(safety.state, S::kFault);
    for (int i = 0; i < 10; ++i) {
      take_stops(safety, i == 0 && is_stopped ? DeviceStatus::kEmergencyStop : DeviceStatus::kOk,
                 Fault::kNone, 0);
      answer_request(safety, RecoveryRequest::kNone, timing, 1000);
      ramp_factor(safety, timing, 1000);
    }
    EXPECT_EQ(safety.state, is_stopped ? S::kFault : S::kRecovering);
  }
}

TEST(Safety, AnAutomaticRequestResetsNoStop) {
  const SafetyTiming timing;
  for (int f = 1; f < kFaults; ++f) {
    const auto fault = static_cast<Fault>(f);
    Safety safety;
    raise(safety, fault, 0);
    safety.ramp_ticks_done = 100;
    for (int i = 0; i < 10; ++i) {
      take_stops(safety, DeviceStatus::kOk, Fault::kNone, 0);
      answer_request(safety, RecoveryRequest::kAutomatic, timing, 1000);
    }
    EXPECT_EQ(safety.state, is_stop(fault) ? S::kFault : S::kRecovering) << to_string(fault);
  }
}

TEST(Safety, APauseEndsARecovery) {
  for (const Fault fault : {Fault::kPaused, Fault::kForcesOff}) {
    Safety safety;
    safety.state = S::kRecovering;
    safety.fault = Fault::kEncoderJump;
    take_stops(safety, DeviceStatus::kLinkLost, fault, 3);
    EXPECT_EQ(safety.state, S::kFault);
    EXPECT_EQ(safety.fault, fault);
    take_stops(safety, DeviceStatus::kLinkLost, fault, 4);
    EXPECT_EQ(safety.faults, 1U);
  }
}

TEST(Safety, ContractUnderRandomEvents) {
  std::mt19937_64 random(11);
  const SafetyTiming timing{0.004, 0.02, 0.01};
  constexpr double kRate_Hz = 1000;
  int recoveries = 0, faults = 0;
  for (int run = 0; run < 200; ++run) {
    Safety safety;
    for (int tick = 0; tick < 500; ++tick) {
      const S before = safety.state;
      const Fault fault_before = safety.fault;
      const std::uint64_t faults_before = safety.faults;
      const std::uint64_t quiet_before = safety.quiet_ticks;
      const bool asked = random() % 8 == 0;
      const bool rested = torques_are_zero(safety, timing, kRate_Hz);
      const bool is_stopped = random() % 100 == 0, waited = safety.waits_for_ramp;
      const bool was_kept = safety.stops.any();
      take_stops(safety, DeviceStatus::kOk, is_stopped ? Fault::kEmergencyStop : Fault::kNone,
                 tick);
      const RecoveryAnswer answer = answer_request(
          safety, asked ? RecoveryRequest::kByOperator : RecoveryRequest::kNone, timing, kRate_Hz);
      ASSERT_EQ(answer, !asked       ? RecoveryAnswer::kNone
                        : is_stopped ? RecoveryAnswer::kRefused
                                     : RecoveryAnswer::kTaken);
      const bool taken = (asked || waited) && rested && !is_stopped;
      const Fault fault =
          random() % 60 == 0 ? static_cast<Fault>(1 + random() % (kFaults - 1)) : Fault::kNone;
      const bool free = random() % 100 != 0;
      advance(safety, timing, kRate_Hz, fault, tick, true, free);
      if (safety.state != S::kRunning) ramp_factor(safety, timing, kRate_Hz);

      const bool stopped = safety.state == S::kFault || safety.state == S::kRecovering;
      ASSERT_EQ(stopped, safety.fault != Fault::kNone);
      if (is_stopped) {
        ASSERT_EQ(safety.state, S::kFault) << "from every state";
        ASSERT_EQ(safety.fault, Fault::kEmergencyStop);
        ASSERT_EQ(safety.faults, faults_before + (was_kept ? 0 : 1));
        ASSERT_EQ(safety.quiet_ticks, 0U);
        continue;
      }
      if (before == S::kFault) {
        ASSERT_EQ(safety.state, taken ? S::kRecovering : S::kFault);
        ASSERT_EQ(safety.fault, fault_before) << "the first fault is kept";
      } else if (before != S::kRecovering && fault != Fault::kNone) {
        ASSERT_EQ(safety.state, S::kFault);
        ASSERT_EQ(safety.fault, fault);
        ++faults;
      }
      if (before == S::kRecovering) {
        ASSERT_TRUE(safety.state == S::kRecovering || safety.state == S::kReady);
        if (fault != Fault::kNone || !free) {
          ASSERT_EQ(safety.quiet_ticks, 0U);
          ASSERT_EQ(safety.state, S::kRecovering);
        } else if (safety.state == S::kReady) {
          ASSERT_EQ(quiet_before, 19U);
          ++recoveries;
        }
      }
      if (safety.state == S::kRunning && before == S::kReady) {
        ASSERT_EQ(safety.authority, safety.recovered ? 0 : 1);
      }
      if (safety.state == S::kRunning && before == S::kRunning) {
        ASSERT_LE(safety.authority, 1);
        ASSERT_GT(safety.authority, 0);
      }
    }
  }
  EXPECT_GT(faults, 500);
  EXPECT_GT(recoveries, 200);
}

// Each limit: kNone within it, its fault beyond it.

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
