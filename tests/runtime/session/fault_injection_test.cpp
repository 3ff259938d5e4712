// SPDX-License-Identifier: Apache-2.0
// Every fault that a device, a sheet, a force law or a hand can cause, injected at random moments
// while the tool is pressed into a sheet, in whole sessions: torques are zero in time, the fault is
// latched and named, the black box is complete, the loop recovers, the recording is complete and
// replays to the last bit. A fault that is not injected here is listed with the reason
// (kNotInjected).
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <random>
#include <thread>

#include "runtime/session/session.h"
#include "runtime/session/session_options.h"
#include "tests/runtime/session/fault_cases.h"
#include "tests/runtime/session/test_session.h"
#include "tests/support/campaign.h"
#include "tests/support/uniform.h"

namespace trocar::runtime {
namespace {

using testing_support::FaultCase;
using testing_support::Injection;
using testing_support::TestSession;
using testing_support::text_of;
using trocar::test::uniform;

constexpr double kRest_s = 0.005;

/// The simulated device, faulty from tick `begin` to `end`.
class FaultyDevice final : public Device {
 public:
  FaultyDevice(SimulatedDevice& inner, Injection injection, std::uint64_t begin, std::uint64_t end)
      : inner_(inner), injection_(std::move(injection)), begin_(begin), end_(end) {}
  DeviceStatus read(DeviceState& state) noexcept override {
    ++tick_;
    DeviceState now;
    inner_.read(now);
    if (tick_ <= begin_) at_begin_ = now;
    if (is_faulty() && injection_.late_ms > 0) {
      std::this_thread::sleep_for(std::chrono::milliseconds(injection_.late_ms));
    }
    if (is_faulty() && injection_.on_read != DeviceStatus::kOk) return injection_.on_read;
    state = now;
    if (is_faulty() && injection_.corrupt) injection_.corrupt(state, at_begin_);
    return DeviceStatus::kOk;
  }
  DeviceStatus write(const DeviceCommand& command) noexcept override {
    if (tick_ > begin_ + 50 && recover != nullptr) recover->store(true);
    if (is_faulty() && injection_.on_write != DeviceStatus::kOk) return injection_.on_write;
    return inner_.write(command);
  }
  /// The operator's button, pressed in every tick from 50 ticks after `begin` on.
  std::atomic<bool>* recover = nullptr;

 private:
  bool is_faulty() const { return tick_ > begin_ && tick_ <= end_; }
  SimulatedDevice& inner_;
  Injection injection_;
  std::uint64_t begin_, end_, tick_ = 0;
  DeviceState at_begin_;
};

/// Down into the sheet, held there, slowly deeper, up, and after a pause down again.
Scene pressing() {
  Scene scene = test::descent_scene({0.12}, 0.122, 0.11, 0.1);
  scene.hand.trajectory = {{0, {0, 0, 0.122}, {}},    {0.05, {0, 0, 0.122}, {}},
                           {0.25, {0, 0, 0.112}, {}}, {0.45, {0, 0, 0.109}, {}},
                           {0.6, {0, 0, 0.122}, {}},  {0.95, {0, 0, 0.122}, {}},
                           {1.15, {0, 0, 0.112}, {}}, {1.3, {0, 0, 0.112}, {}}};
  scene.duration_s = 1.3;
  return scene;
}

/// A limit that was lowered for the test may be exceeded again in the second press.
bool may_fault_again(const FaultCase& test) {
  return !test.at_once && test.lasts_s == 0;
}

void expect_safe_stop_and_recovery(const FaultCase& test, const std::vector<RecordingRow>& rows,
                                   const SessionResult& report, double rate_Hz,
                                   std::uint64_t begin) {
  ASSERT_GE(report.faults.size(), 1U);
  const FaultEvent& event = report.faults.front();
  ASSERT_EQ(event.fault, test.fault) << to_string(event.fault);
  const auto first = static_cast<std::size_t>(std::llround(event.t_s * rate_Hz));
  if (test.at_once) {
    ASSERT_EQ(first, begin);
  }

  // Torques before the fault; then falling to zero in time, with the fault latched.
  double before_Nm = 0, last_Nm = 0;
  for (std::size_t k = test.loaded ? first - 1 : 0; k < first; ++k) {
    for (const double tau : rows[k].tau_Nm)
      before_Nm = std::max(before_Nm, std::abs(tau));
  }
  ASSERT_GT(before_Nm, 0.02) << "under load";
  last_Nm = 1e9;
  std::size_t k = first;
  for (; k < rows.size() && rows[k].safety == SafetyState::kFault; ++k) {
    ASSERT_EQ(rows[k].fault, test.fault);
    double largest_Nm = 0;
    for (const double tau : rows[k].tau_Nm)
      largest_Nm = std::max(largest_Nm, std::abs(tau));
    ASSERT_LE(largest_Nm, last_Nm);
    last_Nm = largest_Nm;
    if (static_cast<double>(k - first) >= kRest_s * rate_Hz - 1e-6) {
      ASSERT_EQ(largest_Nm, 0);
    }
  }
  ASSERT_LE(event.torques_zero_t_s - event.t_s, kRest_s);
  ASSERT_EQ(last_Nm, 0);
  for (; k < rows.size() && rows[k].safety != SafetyState::kRunning; ++k) {
    for (const double tau : rows[k].tau_Nm)
      ASSERT_EQ(tau, 0);
  }
  ASSERT_LT(k, rows.size()) << "no recovery";
  ASSERT_EQ(rows[k].fault, Fault::kNone);
  ASSERT_NEAR(event.recovered_t_s, rows[k].t_s, 1e-9);
  if (may_fault_again(test)) return;
  ASSERT_EQ(report.faults_count, 1U);
  ASSERT_EQ(report.end, SessionEnd::kDone);
  ASSERT_EQ(rows.back().authority, 1);
  ASSERT_NEAR(rows.back().wrench_delivered[2], rows.back().wrench_wanted[2], 1e-9);
  ASSERT_NEAR(rows.back().wrench_wanted[2], rows.back().penetration_m * 5000, 0.05);
  ASSERT_GT(rows.back().wrench_delivered[2], 15) << "forces are back";
}

/// Each black box holds the lines of the recording up to the end of the ramp.
void expect_black_boxes(const SessionResult& report, const std::string& recording, double rate_Hz) {
  ASSERT_EQ(report.black_boxes.size(), report.faults_count);
  ASSERT_EQ(report.black_boxes_lost, 0U);
  std::vector<std::size_t> line{recording.find('\n') + 1};  // where each row begins
  for (std::size_t end; (end = recording.find('\n', line.back())) != std::string::npos;)
    line.push_back(end + 1);
  for (std::size_t i = 0; i < report.black_boxes.size(); ++i) {
    const BlackBoxFile& box = report.black_boxes[i];
    ASSERT_FALSE(box.error) << box.error->message;
    ASSERT_NE(box.file.filename().string().find(to_string(report.faults[i].fault)),
              std::string::npos);
    const auto rest =
        static_cast<std::size_t>(std::llround(report.faults[i].torques_zero_t_s * rate_Hz)) + 1;
    const auto most = static_cast<std::size_t>(kBlackBox_s * rate_Hz);
    const std::size_t from = rest - std::min(rest, most);
    ASSERT_EQ(box.rows, rest - from);
    ASSERT_EQ(text_of(box.file),
              recording.substr(0, line[0]) + recording.substr(line[from], line[rest] - line[from]));
  }
}

void run(const FaultCase& test, int index) {
  std::mt19937_64 random(static_cast<std::uint64_t>(index) * 7919 + test.name[0]);
  Scene scene = pressing();
  if (test.prepare) test.prepare(scene);
  TestSession session(scene);
  SessionOptions& options = session.options;
  options.limits.gap_max_s = SafetyLimits{}.gap_max_s;
  constexpr double kRates_Hz[] = {500, 1000, 2000};
  options.rate_Hz = kRates_Hz[random() % 3];
  options.black_box = session.folder.path();
  options.limits.timing.quiet_s = options.limits.timing.ramp_up_s = 0.05;
  std::atomic<bool> button{false};
  // A stop is never reset by itself.
  const bool by_hand = random() % 2 == 0 || test.fault == Fault::kEmergencyStop;
  options.recovery = by_hand ? RecoveryPolicy::kOnRequest : RecoveryPolicy::kAuto;
  options.recover = &button;
  const double begin_s = 0.18 + 0.25 * uniform(random);
  const auto begin = static_cast<std::uint64_t>(begin_s * options.rate_Hz);
  const auto lasts = static_cast<std::uint64_t>(std::ceil(test.lasts_s * options.rate_Hz));
  Injection injection = test.make(random, options, session.mechanism);
  if (test.fault == Fault::kMotorOverload) {
    session.description.motor_continuous_torque_Nm = 0.1;
    session.description.motor_peak_torque_Nm = 0.6;
    session.description.motor_peak_time_s = 0.01;
  }

  session.simulate();
  FaultyDevice device(*session.device, injection, begin, begin + lasts);
  if (by_hand) device.recover = &button;
  const SessionResult report =
      session.run(device, [&](double dt_s) { session.device->step(dt_s); });
  const std::vector<RecordingRow> rows = session.rows();
  const std::string recording = session.recording();
  ASSERT_EQ(rows.size(), report.ticks) << "no row is lost";
  ASSERT_EQ(report.ticks, tick_count(scene.duration_s, options.rate_Hz));
  expect_safe_stop_and_recovery(test, rows, report, options.rate_Hz, begin);
  if (testing::Test::HasFatalFailure()) return;
  expect_black_boxes(report, recording, options.rate_Hz);
  if (testing::Test::HasFatalFailure()) return;

  options.record = session.folder / "again.csv";
  options.black_box.reset();
  ASSERT_EQ(session.replay(rows).replay_first_difference, -1);
  ASSERT_EQ(session.recording(), recording);
}

class Faults : public testing::TestWithParam<FaultCase> {};
INSTANTIATE_TEST_SUITE_P(Injected, Faults, testing::ValuesIn(testing_support::all_cases()),
                         [](const auto& test) { return std::string(test.param.name); });

TEST_P(Faults, AtRandomMomentsUnderLoad) {
  for (int i = 0; i < trocar::test::campaign(2); ++i) {
    run(GetParam(), i);
    ASSERT_FALSE(HasFatalFailure()) << "run " << i;
  }
}

TEST(Faults, EachIsInjectedOrListedWithAReason) {
  const std::vector<FaultCase> injected = testing_support::all_cases();
  for (int i = 1; i < kFaults; ++i) {
    const auto fault = static_cast<Fault>(i);
    const auto is_it = [fault](const auto& each) { return each.fault == fault; };
    const bool is_injected = std::any_of(injected.begin(), injected.end(), is_it);
    const bool is_listed = std::any_of(std::begin(testing_support::kNotInjected),
                                       std::end(testing_support::kNotInjected), is_it);
    EXPECT_NE(is_injected, is_listed) << to_string(fault);
  }
}

TEST(Faults, ALateTickInRealTime) {
  TestSession session(pressing());
  SessionOptions& options = session.options;
  options.clock = Clock::kReal;
  options.rate_Hz = 500;
  options.duration_s = 0.6;
  options.black_box = session.folder.path();
  options.limits.missed_deadlines_max = 1'000'000;  // of this machine: not under test
  options.limits.gap_max_s = 0.25;
  session.simulate();
  Injection late;
  late.late_ms = 300;
  FaultyDevice device(*session.device, late, 120, 121);
  const SessionResult report =
      session.run(device, [&](double dt_s) { session.device->step(dt_s); });
  EXPECT_EQ(report.end, SessionEnd::kFault);
  EXPECT_EQ(report.fault, Fault::kDeadlineMissed);
  EXPECT_GE(report.realtime.missed_in_row_max, 100);
  const std::vector<RecordingRow> rows = session.rows();
  EXPECT_EQ(rows.size(), report.ticks);
  expect_black_boxes(report, session.recording(), 500);
  // The replay has the fault too, although its own ticks are on time.
  TestSession again(pressing());
  again.options.rate_Hz = 500;
  again.options.limits = SafetyLimits{};
  const SessionResult repeated = again.replay(rows);
  EXPECT_EQ(repeated.replay_first_difference, -1);
  EXPECT_EQ(repeated.fault, Fault::kDeadlineMissed);
}

}  // namespace
}  // namespace trocar::runtime
