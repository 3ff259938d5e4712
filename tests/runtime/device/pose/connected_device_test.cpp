// SPDX-License-Identifier: Apache-2.0
// The contract of ConnectedDevice, with connections that wait, fail and come back. Bounds on times are wide, because the machine
// may stall.
#include "runtime/device/pose/connected_device.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/counted_allocations.h"

namespace trocar::runtime {
namespace {

using namespace std::chrono_literals;

/// Behaviour of a connection. The test changes it while the device's thread uses it.
struct Script {
  std::atomic<bool> opens{true}, fails{false}, repeats{false};
  std::atomic<int> wait_ms{0}, opened{0}, closed{0};
  std::mutex mutex;
  std::vector<HandleWrench> wrenches;  ///< under the mutex
  /// Time of the newest measurement; under the mutex.
  double t_s = 0;

  std::vector<HandleWrench> taken() {
    const std::scoped_lock lock(mutex);
    return std::exchange(wrenches, {});
  }
};

class ScriptedConnection final : public PoseConnection {
 public:
  explicit ScriptedConnection(Script& script) : script_(script) {}
  Result<void> open() override {
    ++script_.opened;
    if (!script_.opens) return Error{ExitCode::kDeviceFault, "test: nothing there"};
    return {};
  }
  Result<PoseReading> exchange(const HandleWrench& wrench) override {
    std::this_thread::sleep_for(std::chrono::milliseconds(script_.wait_ms.load()));
    const std::scoped_lock lock(script_.mutex);
    script_.wrenches.push_back(wrench);
    if (script_.fails) return Error{ExitCode::kDeviceFault, "test: broken"};
    PoseReading reading;
    if (!script_.repeats) script_.t_s += 1e-3;
    reading.t_s = script_.t_s;
    reading.p_m[2] = wrench[2];
    return reading;
  }
  void close() noexcept override { ++script_.closed; }

 private:
  Script& script_;
};

class ConnectedDeviceTest : public testing::Test {
 protected:
  template <typename Done>
  static bool within(std::chrono::milliseconds longest, const Done& done) {
    const auto end = std::chrono::steady_clock::now() + longest;
    while (!done()) {
      if (std::chrono::steady_clock::now() > end) return false;
      std::this_thread::sleep_for(200us);
    }
    return true;
  }
  bool reads(DeviceStatus wanted) {
    return within(5s, [&] { return device_.read(reading_) == wanted; });
  }
  /// Writes again and again, as a loop does, until a reading has this force.
  bool gets(double force_N) {
    return within(5s, [&] {
      device_.write({0, 0, force_N, 0, 0, 0});
      return device_.read(reading_) == DeviceStatus::kOk && reading_.p_m[2] == force_N;
    });
  }

  Script script_;
  std::mutex said_mutex_;
  std::vector<std::string> said_;
  PoseReading reading_;
  ConnectedDevice device_{std::make_unique<ScriptedConnection>(script_), 5e-4,
                          [this](const std::string& line) {
                            const std::scoped_lock lock(said_mutex_);
                            said_.push_back(line);
                          }};
};

TEST_F(ConnectedDeviceTest, NewestWrenchAndPoseGoThrough) {
  ASSERT_TRUE(device_.start());
  EXPECT_TRUE(gets(1.25));
  EXPECT_TRUE(gets(-3.5));
  device_.close();
  EXPECT_EQ(script_.closed, 1);
  EXPECT_EQ(device_.read(reading_), DeviceStatus::kLinkLost);
}

TEST_F(ConnectedDeviceTest, RoundTripIsFromAWrenchToThePoseReturnedForIt) {
  script_.wait_ms = 20;
  ASSERT_TRUE(device_.start());
  EXPECT_TRUE(reads(DeviceStatus::kOk)) << "a pose without a command has no round trip";
  EXPECT_TRUE(gets(1.5));
  device_.close();
  const std::optional<LinkReport> link = device_.link_report();
  ASSERT_TRUE(link);
  EXPECT_EQ(link->sessions, 1U);
  EXPECT_FALSE(link->packets) << "an SDK has no packets that could be counted";
  EXPECT_GE(link->round_trip.samples(), 1U);
  EXPECT_LE(link->round_trip.samples(), script_.taken().size());
  // A command waits for at most one exchange, and its own lasts 20 ms.
  EXPECT_GE(link->round_trip.quantile_us(0), 19'000);
}

TEST_F(ConnectedDeviceTest, ReadAndWriteNeitherWaitNorAllocate) {
  TROCAR_NEEDS_COUNTED_ALLOCATIONS();
  script_.wait_ms = 50;
  ASSERT_TRUE(device_.start());
  std::this_thread::sleep_for(10ms);
  int exchanged = 0;
  const std::uint64_t before = allocations_in_scopes();
  {
    const NoAllocationScope scope;
    for (int i = 0; i < 1000; ++i) {
      device_.write({0, 0, 1, 0, 0, 0});
      exchanged += device_.read(reading_) == DeviceStatus::kOk ? 1 : 0;
    }
  }
  EXPECT_EQ(allocations_in_scopes() - before, 0U);
  // A thousand calls are done before the connection answers a second time.
  EXPECT_LE(exchanged, 2);
}

TEST_F(ConnectedDeviceTest, SilentLoopGivesNoForce) {
  ASSERT_TRUE(device_.start());
  EXPECT_TRUE(gets(4));
  EXPECT_TRUE(within(5s, [&] {
    const auto wrenches = script_.taken();
    return !wrenches.empty() && wrenches.back() == HandleWrench{};
  }));
  EXPECT_TRUE(gets(2)) << "and force again when the loop goes on";
}

// A loop of 5 Hz, which writes every second period and sometimes late: 0.5 s are five periods.
TEST_F(ConnectedDeviceTest, ForceOfASlowLoopIsSentUntilItsNextWrite) {
  Script slow;
  ConnectedDevice device(std::make_unique<ScriptedConnection>(slow), 0.1, [](const auto&) {});
  ASSERT_TRUE(device.start());
  device.write({0, 0, 4, 0, 0, 0});
  std::vector<HandleWrench> sent;
  EXPECT_TRUE(within(5s, [&] {
    for (const HandleWrench& wrench : slow.taken())
      if (!sent.empty() || wrench[2] == 4) sent.push_back(wrench);
    return sent.size() >= 3;
  }));
  for (std::size_t i = 0; i < 3 && i < sent.size(); ++i)
    EXPECT_EQ(sent[i][2], 4) << i;
  EXPECT_TRUE(within(5s, [&] {
    const auto wrenches = slow.taken();
    return !wrenches.empty() && wrenches.back() == HandleWrench{};
  })) << "but not for ever";
}

TEST_F(ConnectedDeviceTest, AMeasurementThatIsGivenAgainIsReadOnce) {
  ASSERT_TRUE(device_.start());
  EXPECT_TRUE(reads(DeviceStatus::kOk));
  script_.repeats = true;
  script_.taken();
  EXPECT_TRUE(within(5s, [&] { return !script_.taken().empty(); }));
  device_.read(reading_);  // the last new one, if it has not been read
  const double last_s = reading_.t_s;
  int exchanged = 0;
  EXPECT_TRUE(within(5s, [&] {
    exchanged += static_cast<int>(script_.taken().size());
    EXPECT_EQ(device_.read(reading_), DeviceStatus::kNoData);
    return exchanged >= 5;
  }));
  script_.repeats = false;
  EXPECT_TRUE(reads(DeviceStatus::kOk));
  EXPECT_GT(reading_.t_s, last_s);
}

TEST_F(ConnectedDeviceTest, ErrorIsLinkLostAtOnceAndSaidOnce) {
  ASSERT_TRUE(device_.start());
  EXPECT_TRUE(gets(4));
  script_.fails = true;
  EXPECT_TRUE(reads(DeviceStatus::kLinkLost));
  std::this_thread::sleep_for(20ms);
  EXPECT_EQ(device_.read(reading_), DeviceStatus::kLinkLost) << "until it is restored";
  const std::scoped_lock lock(said_mutex_);
  EXPECT_EQ(said_, std::vector<std::string>{"test: broken"});
  EXPECT_EQ(script_.closed, 1);
}

TEST_F(ConnectedDeviceTest, RestoresWithoutForce) {
  ASSERT_TRUE(device_.start());
  EXPECT_TRUE(gets(4));
  script_.fails = true;
  script_.opens = false;
  EXPECT_TRUE(reads(DeviceStatus::kLinkLost));
  device_.write({0, 0, 7, 0, 0, 0});
  device_.restore();
  EXPECT_TRUE(within(5s, [&] { return script_.opened >= 2; }));
  script_.fails = false;
  script_.opens = true;
  script_.taken();
  EXPECT_TRUE(within(5s, [&] {
    device_.restore();
    return device_.read(reading_) == DeviceStatus::kOk;
  }));
  EXPECT_EQ(script_.taken().front(), HandleWrench{}) << "not the force from before";
  EXPECT_TRUE(gets(1));
}

TEST_F(ConnectedDeviceTest, NoPoseFromBeforeALossIsReadAfterIt) {
  ASSERT_TRUE(device_.start());
  EXPECT_TRUE(reads(DeviceStatus::kOk));
  script_.taken();
  EXPECT_TRUE(within(5s, [&] { return !script_.taken().empty(); }));  // and nobody reads its pose
  script_.fails = true;
  EXPECT_TRUE(within(5s, [&] { return script_.closed > 0; }));
  const double before_s = script_.t_s;
  EXPECT_EQ(device_.read(reading_), DeviceStatus::kLinkLost);
  script_.fails = false;
  script_.wait_ms = 50;
  device_.restore();
  DeviceStatus status = DeviceStatus::kLinkLost;
  EXPECT_TRUE(within(5s, [&] {
    status = device_.read(reading_);
    return status == DeviceStatus::kOk;
  }));
  EXPECT_GT(reading_.t_s, before_s);
}

// The thread for calls of a foreign library, which may hang.

constexpr double kLong_s = 30;  // no test waits for so long
constexpr double kShort_s = 0.02;

/// A call that hangs until it is released. Its copies share the state.
struct Hanging {
  std::shared_ptr<std::atomic<bool>> released = std::make_shared<std::atomic<bool>>(false);
  std::shared_ptr<std::atomic<int>> returned = std::make_shared<std::atomic<int>>(0);
  int operator()() const {
    while (!*released)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return ++*returned;
  }
};

TEST(CallThread, ReturnsTheResultsOfOneThread) {
  CallThread calls;
  const auto first = calls.call([] { return std::this_thread::get_id(); }, kLong_s);
  const auto second = calls.call([] { return std::this_thread::get_id(); }, kLong_s);
  ASSERT_TRUE(first && second);
  EXPECT_EQ(*first, *second);
  EXPECT_NE(*first, std::this_thread::get_id());
  EXPECT_EQ(calls.call([] { return std::string("text"); }, kLong_s), "text");
}

TEST(CallThread, GivesUpOnACallThatHangs) {
  CallThread calls;
  const Hanging hanging;
  EXPECT_EQ(calls.call(hanging, kShort_s), std::nullopt);
  EXPECT_EQ(*hanging.returned, 0);
  std::atomic<bool> begun = false;
  EXPECT_EQ(calls.call([&] { return begun = true; }, kShort_s), std::nullopt);
  *hanging.released = true;
  EXPECT_EQ(calls.call([] { return 5; }, kLong_s), 5);
  EXPECT_EQ(*hanging.returned, 1);
  EXPECT_FALSE(begun);  // a call that was given up before it began is never made
}

TEST(CallThread, LastCallFollowsTheOneThatHangs) {
  CallThread calls;
  const Hanging hanging;
  EXPECT_EQ(calls.call(hanging, kShort_s), std::nullopt);
  int replaced = 0;
  int after = -1;
  calls.call_at_last([&] { ++replaced; });
  calls.call_at_last([&, hanging] { after = *hanging.returned; });
  EXPECT_EQ(after, -1);
  *hanging.released = true;
  EXPECT_EQ(calls.call([&] { return after; }, kLong_s), 1);
  EXPECT_EQ(replaced, 0);
  calls.call_at_last([&] { after = 7; });  // waits for it, as nothing hangs
  EXPECT_EQ(calls.call([&] { return after; }, kLong_s), 7);
}

TEST(CallThread, CanBeDestroyedWhileACallHangs) {
  const Hanging hanging;
  const auto last = std::make_shared<std::atomic<bool>>(false);
  {
    CallThread calls;
    EXPECT_EQ(calls.call(hanging, kShort_s), std::nullopt);
    calls.call_at_last([last] { *last = true; });
  }
  *hanging.released = true;
  for (int i = 0; i < 10'000 && !*last; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_TRUE(*last);  // also the last call is still made
}

// Texts of a foreign library or service.

TEST(ForeignText, BecomesOneShortLineOfPrintableCharacters) {
  EXPECT_EQ(foreign_text("omega.3 ~"), "omega.3 ~");
  EXPECT_EQ(foreign_text("a\nb\r\x1b[2J\x7f\xc3\xa9"), "a?b??[2J???");
  EXPECT_EQ(foreign_text(std::string_view("a\0b", 3)), "a?b");
  EXPECT_EQ(foreign_text("12345", 5), "12345");
  EXPECT_EQ(foreign_text("123456", 5), "12345...");
  EXPECT_EQ(foreign_text(std::string(100'000, 'x')).size(), 303U);
}

TEST(ForeignText, NoTextIsSaid) {
  EXPECT_EQ(foreign_text(""), "(no text)");
  EXPECT_EQ(foreign_text(static_cast<const char*>(nullptr)), "(no text)");
}

}  // namespace
}  // namespace trocar::runtime
