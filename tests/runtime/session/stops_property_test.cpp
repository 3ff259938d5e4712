// SPDX-License-Identifier: Apache-2.0
// No entry into `running` without a request that is newer than the last release of every stop, in
// whole sessions in virtual time, over random sequences of device stops, operator's stops, pauses,
// faults, link losses and recoveries. The witness keeps its own record of presses, releases and
// requests, and takes nothing but the state from the session.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "runtime/session/open_device.h"
#include "runtime/session/pose_session.h"
#include "runtime/session/session.h"
#include "tests/runtime/device/link/udp_peer.h"
#include "tests/support/body_fixture.h"
#include "tests/support/campaign.h"
#include "tests/support/sheet_fixture.h"
#include "tests/support/temporary_folder.h"

namespace trocar::runtime::stops_property {
namespace {

using Engine = std::mt19937_64;

bool happens(Engine& random, double probability) {
  return static_cast<double>(random() >> 11) * 0x1p-53 < probability;
}

/// What was pressed, released and requested, by the period of the loop that could first see it.
class Witness {
 public:
  /// Begins a period of the loop, which sees the commands that were given in the period before.
  void begin_period() {
    ++period_;
    using enum TelemetryCommand;
    for (const TelemetryCommand command : given_) {
      if (command == kEmergencyStop) emergency_ = period_;
      if (command == kZero) zero_ = period_;
      if (command == kPause) pause_ = period_;
      if (command == kRecover) recover_ = period_;
      if (command == kResume) resume_ = period_;
    }
    given_.clear();
  }
  void give(TelemetryCommand command) { given_.push_back(command); }
  void device_told(DeviceStatus status) {
    if (status == DeviceStatus::kNoData || status == DeviceStatus::kLinkLost) return;
    const bool is_held = status == DeviceStatus::kEmergencyStop || says_write_;
    if (is_held || is_held_) device_released_ = period_;
    is_held_ = is_held;
  }
  void device_answered(DeviceStatus status) {
    says_write_ = status == DeviceStatus::kEmergencyStop;
    is_held_ |= says_write_;
    if (says_write_) device_released_ = period_;
  }
  /// Why the forces may not return now; empty: they may.
  std::string objection() const {
    if (is_held_) return "the device's stop is held";
    if (device_released_ >= recover_) return "no request after the device's stop was released";
    if (emergency_ >= recover_) return "no request after the operator's emergency stop";
    if (zero_ >= recover_) return "no request after the forces were switched off";
    if (pause_ >= std::max(recover_, resume_)) return "no request after the pause";
    return {};
  }

 private:
  static constexpr std::int64_t kNever = -1;
  std::int64_t period_ = 0;
  std::vector<TelemetryCommand> given_;
  bool is_held_ = false, says_write_ = false;
  std::int64_t device_released_ = kNever - 1, emergency_ = kNever - 1, zero_ = kNever - 1,
               pause_ = kNever - 1, recover_ = kNever, resume_ = kNever;
};

/// A device whose stop is pressed and whose link is lost at random, and whose checks fail.
class TroubledDevice final : public HandDevice {
 public:
  TroubledDevice(HandDevice& inner, Witness& witness, Engine& random, bool is_paced, bool fails)
      : inner_(inner), witness_(witness), random_(random), is_paced_(is_paced), fails_(fails) {}
  bool has_own_stop = false;  ///< `inner` reports stops itself

  DeviceStatus read(double& t_s) noexcept override {
    for (int* const left : {&stopped_, &silent_, &lost_, &broken_, &wrong_})
      *left = std::max(0, *left - 1);
    if (!has_own_stop) begin(stopped_, 0.012, 40);
    begin(silent_, 0.01, 15);
    begin(lost_, 0.004, 30);
    begin(broken_, 0.002, 20);
    if (fails_) begin(wrong_, 0.004, 6);
    const DeviceStatus status = lost_ > 0      ? DeviceStatus::kLinkLost
                                : silent_ > 0  ? DeviceStatus::kNoData
                                : stopped_ > 0 ? DeviceStatus::kEmergencyStop
                                : broken_ > 0  ? DeviceStatus::kMotorFault
                                               : inner_.read(t_s);
    witness_.device_told(status);
    return status;
  }
  FaultDetail find_pose(const ReadingInterval& interval, PlatePose& pose) noexcept override {
    const FaultDetail found = inner_.find_pose(interval, pose);
    return wrong_ > 0 ? FaultDetail(Fault::kEncoderJump) : found;
  }
  DeviceStatus write() noexcept override {
    DeviceStatus status = inner_.write();
    if (happens(random_, 0.001)) status = DeviceStatus::kNoData;
    if (happens(random_, 0.0005)) status = DeviceStatus::kEmergencyStop;
    witness_.device_answered(status);
    return status;
  }
  const DeviceSpecification& specification() const noexcept override {
    return inner_.specification();
  }
  void use_last_reading() noexcept override { inner_.use_last_reading(); }
  const Measurement& measured() const noexcept override { return inner_.measured(); }
  bool keep_reading() noexcept override { return inner_.keep_reading(); }
  FaultDetail check_own_workspace() const noexcept override { return inner_.check_own_workspace(); }
  FaultDetail account_held_time(double held_s) noexcept override {
    return inner_.account_held_time(held_s);
  }
  FaultDetail check_rested() const noexcept override { return inner_.check_rested(); }
  FaultDetail render(const RenderInput& input, double& scale) noexcept override {
    return inner_.render(input, scale);
  }
  void stop() noexcept override { inner_.stop(); }
  void fade(double share) noexcept override { inner_.fade(share); }
  void write_zero() noexcept override { inner_.write_zero(); }
  Wrench delivered() const noexcept override { return inner_.delivered(); }
  FaultDetail fault_of(DeviceStatus status) const noexcept override {
    return inner_.fault_of(status);
  }
  void restore() noexcept override { lost_ = std::min(lost_, 3); }
  void describe(RecordingRow& row, DeviceReadout& readout) const noexcept override {
    inner_.describe(row, readout);
  }
  void advance(double dt_s) override { inner_.advance(dt_s); }
  bool is_paced_by_loop() const override { return is_paced_; }

 private:
  void begin(int& left, double probability, unsigned longest) noexcept {
    if (left == 0 && happens(random_, probability))
      left = 1 + static_cast<int>(random_() % longest);
  }
  HandDevice& inner_;
  Witness& witness_;
  Engine& random_;
  bool is_paced_, fails_;
  int stopped_ = 0, silent_ = 0, lost_ = 0, broken_ = 0, wrong_ = 0;  ///< reads that are left
};

/// The operator. The session calls it once in each period, also in a pause.
class RandomOperator final : public HandReceiver {
 public:
  RandomOperator(Witness& witness, Engine& random, std::atomic<bool>& signal)
      : witness_(witness), random_(random), signal_(signal) {}
  std::unique_ptr<TelemetryReader> memory;

  std::optional<TelemetryEventKind> receive(const TelemetryHand&, std::int64_t) noexcept override {
    using enum TelemetryCommand;
    witness_.begin_period();
    constexpr std::pair<TelemetryCommand, double> kProbabilities[] = {{kPause, 0.003},
                                                                      {kZero, 0.003},
                                                                      {kEmergencyStop, 0.003},
                                                                      {kResume, 0.02},
                                                                      {kRecover, 0.04}};
    const double more = is_paused_ ? 10 : 1;  // time stands still, and the session sleeps
    for (const auto& [command, probability] : kProbabilities) {
      if (!happens(random_, std::min(1.0, more * probability))) continue;
      const bool by_signal = command == kRecover && random_() % 2 == 0;
      if (by_signal)
        signal_.store(true);
      else
        memory->command(command);
      witness_.give(command);
      is_paused_ = command == kPause;
    }
    return {};
  }
  void restart_at_tip() noexcept override {}

 private:
  Witness& witness_;
  Engine& random_;
  std::atomic<bool>& signal_;
  bool is_paused_ = false;
};

/// Counts the entries into `running` and those to which the witness objects.
class EntryCounter final : public TickObserver {
 public:
  /// After `wanted` entries, ends the session by `enough`.
  EntryCounter(const Witness& witness, int wanted) : witness_(witness), wanted_(wanted) {}
  void on_tick(const TickView& tick) noexcept override {
    const RecordingRow& row = tick.result.row;
    const bool is_running = row.safety == SafetyState::kRunning;
    if (is_running && !was_running_) {
      enough = ++entries >= wanted_;
      if (const std::string why = witness_.objection(); !why.empty() && objection.empty())
        objection = "at " + std::to_string(row.t_s) + " s: " + why;
    }
    was_running_ = is_running;
    rows.push_back(row);
  }
  int entries = 0;
  std::string objection;
  std::vector<RecordingRow> rows;
  std::atomic<bool> enough{false};

 private:
  const Witness& witness_;
  int wanted_;
  bool was_running_ = false;
};

PoseDeviceDescription arm() {
  PoseDeviceDescription device;
  device.name = "arm";
  device.force_max_N = 60;
  device.stiffness_max_N_per_m = 3000;
  device.mass_kg = 0.3;
  device.damping_N_s_per_m = 1;
  device.position_resolution_m = 1e-5;
  device.workspace_min_m = {-0.08, -0.08, -0.08};
  device.workspace_max_m = {0.08, 0.08, 0.08};
  return device;
}

/// A hand above the bone, which it touches now and then.
Scene scene_of(ForceLawKind law) {
  Scene scene = law == ForceLawKind::kCutting ? test::cutting_scene({0.12})
                                              : test::descent_scene({0.12}, 0.13, 0.117, 0.1);
  scene.tissue.threshold_N = 1000;
  scene.force_law.kind = law;
  scene.hand.trajectory = {{0, {0, 0, 0.128}, {}}};
  for (int i = 0; i < 40; ++i) {
    const double t_s = 0.2 + 0.25 * i;
    scene.hand.trajectory.push_back({t_s, {0, 0, 0.128}, {}});
    scene.hand.trajectory.push_back({t_s + 0.04, {0, 0, 0.1185}, {}});
    scene.hand.trajectory.push_back({t_s + 0.08, {0, 0, 0.128}, {}});
  }
  scene.duration_s = 10;
  return scene;
}

enum class Kind : std::uint8_t { kFourLegs, kPoseDevice, kLink };
struct Combination {
  RecoveryPolicy policy;
  Kind kind;
  ForceLawKind law;
};

/// Some stops, for the drive of a link in lock-step.
std::string random_stops(Engine& random) {
  std::string plan;
  double t_s = 0.01;
  while (t_s < 10) {
    t_s += 0.001 * static_cast<double>(1 + random() % 160);
    const double to_s = t_s + 0.001 * static_cast<double>(1 + random() % 40);
    plan += (plan.empty() ? "stop@" : ",stop@") + std::to_string(t_s) + ".." + std::to_string(to_s);
    t_s = to_s;
  }
  return plan;
}

AnyDeviceDescription description_of(const Combination& what) {
  if (what.kind == Kind::kPoseDevice) return arm();
  return default_device_description();
}

/// Runs a session. Returns the number of its entries, at most `wanted`.
int run(const Combination& what, std::uint64_t seed, int wanted) {
  Engine random(seed);
  Witness witness;
  const Scene scene = scene_of(what.law);
  const AnyDeviceDescription description = description_of(what);
  const bool fails = seed % 4 != 0;  // a replay knows nothing of the checks that fail here
  const auto simulated = simulate_device(scene, description);
  EXPECT_TRUE(simulated) << simulated.error().message;
  std::optional<testing_support::Peer> drive;
  OpenedDevice linked;
  if (what.kind == Kind::kLink) {
    drive.emplace(LinkClock::kLockStep, random_stops(random).c_str());
    auto link = testing_support::connect(testing_support::to(*drive, LinkClock::kLockStep));
    EXPECT_TRUE(link) << link.error().message;
    linked = make_four_legs(default_device_description(), std::move(*link));
  }
  TroubledDevice device(drive ? *linked.device : **simulated, witness, random,
                        drive || seed % 2 == 0, fails);
  device.has_own_stop = drive.has_value();
  std::atomic<bool> signal{false};
  RandomOperator by_operator(witness, random, signal);
  EntryCounter counter(witness, wanted);
  const test::TemporaryFolder folder;
  SessionOptions options;
  options.clock = Clock::kVirtual;
  options.duration_s = scene.duration_s;
  options.recovery = what.policy;
  options.recover = &signal;
  options.hand = &by_operator;
  options.stop = &counter.enough;
  options.limits.gap_max_s = 0;
  options.telemetry = TelemetryOptions{folder / "live", "", "", "", {}};
  if (what.kind == Kind::kPoseDevice) set_pose_device_options(arm(), scene, options);
  options.limits.timing.quiet_s = options.limits.timing.ramp_up_s = 0.01;
  options.observers = {&counter};
  Remesher remesher(*place_slices(scene, test::square_asset(1), "a"));
  auto workers = make_workers(scene, device.specification(), remesher, options);
  EXPECT_TRUE(workers) << workers.error().message;
  auto memory = TelemetryReader::open(folder / "live");
  EXPECT_TRUE(memory);
  by_operator.memory = std::move(*memory);
  run_session(
      scene, remesher, device, [&](double dt_s) { device.advance(dt_s); }, options,
      std::move(*workers));
  EXPECT_EQ(counter.objection, "") << "seed " << seed;
  if (fails || counter.rows.empty()) return counter.entries;

  SessionOptions again = options;
  again.replay = counter.rows;
  again.hand = nullptr;
  again.stop = nullptr;
  again.observers.clear();
  again.telemetry.reset();
  const OpenedDevice replayed =
      what.kind == Kind::kPoseDevice
          ? make_pose_hand(arm(), scene, std::make_unique<ReplayPoseDevice>(counter.rows))
          : make_four_legs(default_device_description(),
                           std::make_unique<ReplayDevice>(counter.rows));
  Remesher fresh(*place_slices(scene, test::square_asset(1), "a"));
  const auto repeated = run_session(
      scene, fresh, *replayed.device, [](double) {}, again);
  EXPECT_TRUE(repeated);
  EXPECT_EQ(repeated->replay_first_difference, -1) << "seed " << seed;
  return counter.entries;
}

TEST(Stops, ForcesReturnOnlyAfterARequestNewerThanEveryRelease) {
  std::vector<Combination> all;
  for (const RecoveryPolicy policy :
       {RecoveryPolicy::kNever, RecoveryPolicy::kOnRequest, RecoveryPolicy::kAuto})
    for (const Kind kind : {Kind::kFourLegs, Kind::kPoseDevice, Kind::kLink})
      for (const ForceLawKind law :
           {ForceLawKind::kHooke, ForceLawKind::kNetwork, ForceLawKind::kCutting})
        all.push_back({policy, kind, law});
  const int of_each =
      (test::campaign(100) + static_cast<int>(all.size()) - 1) / static_cast<int>(all.size());
  std::uint64_t seed = 70'000;
  for (const Combination& each : all) {
    int entries = 0;
    for (int sessions = 0; entries < of_each && sessions < 20 + of_each; ++sessions) {
      entries += run(each, seed++, of_each - entries);
      ASSERT_FALSE(HasFailure()) << "policy " << static_cast<int>(each.policy) << ", law "
                                 << to_string(each.law) << ", device "
                                 << static_cast<int>(each.kind);
    }
    EXPECT_GE(entries, of_each) << static_cast<int>(each.policy) << to_string(each.law);
  }
}

}  // namespace
}  // namespace trocar::runtime::stops_property
