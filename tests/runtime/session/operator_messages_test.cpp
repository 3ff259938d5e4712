// SPDX-License-Identifier: Apache-2.0
// Messages to the operator are reported while the session runs and not by the haptic thread. A
// recovery that is held up is reported once for each reason.
#include "runtime/session/operator_messages.h"

#include <gtest/gtest.h>

#include <atomic>
#include <string>
#include <thread>
#include <vector>

#include "tests/runtime/session/test_session.h"

namespace trocar::runtime {
namespace {

using testing_support::TestSession;

/// The simulated device; its emergency stop is pressed from tick `begin` to `end`. The operator asks
/// for recovery once in between, and once after it.
class StoppedDevice final : public Device {
 public:
  StoppedDevice(SimulatedDevice& inner, std::uint64_t begin, std::uint64_t end)
      : inner_(inner), begin_(begin), end_(end) {}
  DeviceStatus read(DeviceState& state) noexcept override {
    ++ticks;
    haptic_thread = std::this_thread::get_id();
    if (ticks == (begin_ + end_) / 2 || ticks == end_ + 10) recover.store(true);
    if (ticks > begin_ && ticks <= end_) return DeviceStatus::kEmergencyStop;
    return inner_.read(state);
  }
  DeviceStatus write(const DeviceCommand& command) noexcept override {
    return inner_.write(command);
  }
  std::atomic<std::uint64_t> ticks{0};
  std::atomic<bool> recover{false};
  std::thread::id haptic_thread;

 private:
  SimulatedDevice& inner_;
  std::uint64_t begin_, end_;
};

/// A hand that presses 9 mm deep from 0.2 s to 0.6 s, and is above the sheet from 0.8 s on.
Scene scene_that_presses() {
  Scene scene = test::descent_scene({0.12}, 0.122, 0.11, 0.1);
  scene.hand.trajectory = {{0, {0, 0, 0.122}, {}},
                           {0.2, {0, 0, 0.1155}, {}},
                           {0.6, {0, 0, 0.1155}, {}},
                           {0.8, {0, 0, 0.122}, {}}};
  scene.duration_s = 1.4;
  return scene;
}

struct Told {
  OperatorMessage notice;
  std::uint64_t at_tick = 0;
  std::thread::id thread;
};

std::vector<Told> run(Clock clock, std::thread::id& haptic_thread) {
  TestSession session(scene_that_presses());
  session.simulate();
  StoppedDevice device(*session.device, 100, 250);  // at 500 Hz: from 0.2 s to 0.5 s
  std::vector<Told> told;
  SessionOptions& options = session.options;
  options.clock = clock;
  options.rate_Hz = 500;
  options.record.reset();
  options.recovery = RecoveryPolicy::kOnRequest;
  options.recover = &device.recover;
  options.on_message = [&](const OperatorMessage& notice) {
    told.push_back({notice, device.ticks.load(), std::this_thread::get_id()});
  };
  const SessionResult report =
      session.run(device, [&](double dt_s) { session.device->step(dt_s); });
  EXPECT_EQ(report.end, SessionEnd::kDone);
  EXPECT_EQ(report.faults.at(0).detail.fault, Fault::kEmergencyStop);
  haptic_thread = device.haptic_thread;
  return told;
}

TEST(OperatorMessages, AreToldDuringTheSessionOnceForEachReason) {
  for (const Clock clock : {Clock::kVirtual, Clock::kReal}) {
    std::thread::id haptic_thread;
    const std::vector<Told> told = run(clock, haptic_thread);
    ASSERT_EQ(told.size(), 4U);
    using Kind = OperatorMessage::Kind;
    const std::pair<Kind, Fault> wanted[] = {{Kind::kFault, Fault::kEmergencyStop},
                                             {Kind::kRefused, Fault::kEmergencyStop},
                                             {Kind::kNotRecovered, Fault::kNone},
                                             {Kind::kRecovered, Fault::kEmergencyStop}};
    for (std::size_t i = 0; i < told.size(); ++i) {
      EXPECT_EQ(told[i].notice.kind, wanted[i].first) << i;
      EXPECT_EQ(told[i].notice.detail.fault, wanted[i].second) << i;
      EXPECT_LT(told[i].at_tick, 700U) << "while the session runs";
      EXPECT_EQ(told[i].thread == haptic_thread, clock == Clock::kVirtual);
    }
    EXPECT_EQ(told[0].notice.t_s, 0.2);
    EXPECT_GT(told[2].notice.retract_distance_m, 0.001);
    EXPECT_EQ(
        describe(told[0].notice),
        "fault emergency_stop at 0.2000 s: the emergency stop is pressed, the device's or the "
        "operator's; release it when that is safe");
    EXPECT_EQ(describe(told[1].notice).rfind("recovery refused at 0.35", 0), 0U);
  }
}

TEST(OperatorCommands, ASessionWaitsAfterAPauseButNotAfterAFaultOrAStop) {
  OperatorCommands commands(RecoveryPolicy::kNever, nullptr);
  EXPECT_TRUE(commands.waits_for_operator(Fault::kPaused));
  EXPECT_FALSE(commands.waits_for_operator(Fault::kMotorOverload));
  TelemetryCommands stop;
  stop.emergency_stop = true;
  commands.apply(stop, Fault::kPaused);
  EXPECT_FALSE(commands.waits_for_operator(Fault::kPaused));
}

TEST(OperatorMessages, TheToolIsToBeLiftedByWholeMillimetresThatAreEnough) {
  OperatorMessage notice{OperatorMessage::Kind::kNotRecovered, 1, {}, 0.0142};
  EXPECT_EQ(describe(notice),
            "no recovery yet at 1.0000 s: the tool is in material: lift it 15 mm");
  notice.retract_distance_m = 0.015;
  EXPECT_NE(describe(notice).find("lift it 15 mm"), std::string::npos);
  notice.retract_distance_m = 1e-12;
  EXPECT_NE(describe(notice).find("lift it 1 mm"), std::string::npos);
  notice.detail = {Fault::kMotorOverload, FaultQuantity::kMotorHeat, 2, 0.82, 0.5};
  EXPECT_EQ(describe(notice),
            "no recovery yet at 1.0000 s: the motors are still hot (thermal state of motor theta 1 "
            "of leg 2 82 %, limit 50 %); lift the tool, let the motors cool, and press with less "
            "force");
}

TEST(RecoveryWatch, TellsAReasonOnceAfterAMoment) {
  RecoveryWatch watch;
  const FaultDetail stop = Fault::kEmergencyStop;
  int told = 0;
  double first_s = -1;
  for (int ms = 0; ms < 5000; ++ms) {
    if (!watch.should_report(true, ms * 1e-3, stop, 0)) continue;
    ++told;
    first_s = ms * 1e-3;
  }
  EXPECT_EQ(told, 1);
  EXPECT_NEAR(first_s, RecoveryWatch::kPatience_s, 1.5e-3);
  EXPECT_TRUE(watch.should_report(true, 5, {}, 0.01)) << "another reason";
  EXPECT_FALSE(watch.should_report(true, 5.1, {}, 0.02));
  EXPECT_FALSE(watch.should_report(true, 5.2, {}, 0)) << "nothing prevents it";
  watch.fault_latched();
  EXPECT_FALSE(watch.should_report(false, 6, stop, 0)) << "not asked for";
  EXPECT_FALSE(watch.should_report(true, 6.05, stop, 0));
  EXPECT_TRUE(watch.should_report(true, 6.2, stop, 0)) << "after another fault it is told again";
}

}  // namespace
}  // namespace trocar::runtime
