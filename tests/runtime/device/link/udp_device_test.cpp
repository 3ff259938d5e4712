// SPDX-License-Identifier: Apache-2.0
// The loop's side of the link over real sockets of this machine: accepted and refused packets,
// connecting, when the link counts as lost, new sessions after a loss, and no allocation.
#include "runtime/device/link/udp_link.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <csignal>
#include <functional>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>

#include "runtime/realtime/realtime_thread.h"
#include "tests/runtime/device/link/udp_peer.h"
#include "tests/support/counted_allocations.h"

namespace trocar::runtime {
namespace {

using namespace testing_support;
using SteadyClock = std::chrono::steady_clock;

class UdpDeviceTest : public testing::Test {
 protected:
  using Change = std::function<void(UdpLinkOptions&)>;
  /// Starts a drive, and the device that is connected to it.
  void start(LinkClock clock = LinkClock::kReal, const char* faults = "", double watchdog_s = 10,
             const Change& change = {}) {
    peer_ = std::make_unique<Peer>(clock, faults, watchdog_s);
    at_ = peer_->endpoint;
    key_ = peer_->key;
    UdpLinkOptions options = to(*peer_, clock);
    if (change) change(options);
    connect_to(options);
  }
  void start_with(const Change& change) { start(LinkClock::kReal, "", 10, change); }
  /// Starts the drive again, as another one at the same address.
  void restart(LinkClock clock, double watchdog_s = 10) {
    peer_ = std::make_unique<Peer>(clock, "", watchdog_s, at_, key_);
  }
  void connect_to(const UdpLinkOptions& options) {
    device_ = connected(options);
    if (!device_) throw std::runtime_error("not connected");
  }
  /// The status of read(), which is called each millisecond until it is this one, for at most five seconds.
  DeviceStatus read_until(DeviceStatus wanted, bool writes = false) {
    DeviceStatus status = DeviceStatus::kOk;
    for (int ms = 0; ms < 5000 && status != wanted; ++ms) {
      if (writes) device_->write({});
      sleep_ms(1);
      status = device_->read(state_);
    }
    return status;
  }
  template <typename Link = UdpDevice>
  static void expect_refused(const UdpLinkOptions& options, ExitCode code, const char* words) {
    auto made = Link::make(options);
    ASSERT_TRUE(made);
    const Result<void> started = (*made)->start();
    ASSERT_FALSE(started) << words;
    EXPECT_EQ(started.error().code, code);
    EXPECT_NE(started.error().message.find(words), std::string::npos) << started.error().message;
  }
  DeviceStatus next_state() { return next(*device_, state_); }
  /// Writes, and waits for the answer in lock-step.
  DeviceStatus answer_to(const DeviceCommand& command) {
    EXPECT_EQ(device_->write(command), DeviceStatus::kOk);
    EXPECT_TRUE(device_->wait_for_answer());
    return device_->read(state_);
  }
  std::unique_ptr<Peer> peer_;  // outlives the device
  std::unique_ptr<UdpDevice> device_;
  Endpoint at_;
  LinkKey key_;
  DeviceState state_;
};

TEST(Endpoint, ParsesHostAndPort) {
  const auto good = parse_endpoint("127.0.0.1:4840", 1);
  ASSERT_TRUE(good);
  EXPECT_EQ(*good, (Endpoint{0x7f000001, 4840}));
  EXPECT_TRUE(good->is_loopback());
  EXPECT_EQ(to_string(*good), "127.0.0.1:4840");
  EXPECT_TRUE(parse_endpoint("localhost:1", 1)->is_loopback());
  EXPECT_FALSE(parse_endpoint("192.0.2.1:9", 1)->is_loopback());
  EXPECT_TRUE(parse_endpoint("127.0.0.1:0", 0));
  for (const char* bad :
       {"", ":", "127.0.0.1", "127.0.0.1:", ":4840", "127.0.0.1:0", "127.0.0.1:65536",
        "127.0.0.1:-1", "127.0.0.1:4840x", "127.0.0.1: 1", "300.0.0.1:1"}) {
    const auto refused = parse_endpoint(bad, 1);
    ASSERT_FALSE(refused) << bad;
    EXPECT_EQ(refused.error().code, ExitCode::kUsage);
  }
  const auto taken = UdpSocket::listen({0x7f000001, 0});
  ASSERT_TRUE(taken);
  const auto twice = UdpSocket::listen(taken->local());
  ASSERT_FALSE(twice);
  EXPECT_EQ(twice.error().code, ExitCode::kUnwritable);
}

TEST_F(UdpDeviceTest, ReadGivesTheNewestOfSeveralStates) {
  start();
  DeviceState last;
  next_state();
  peer_->wait_for_states(10);
  ASSERT_EQ(device_->read(last), DeviceStatus::kOk);
  EXPECT_GT(last.t_s, state_.t_s + 9e-3);
  EXPECT_GT(device_->packets().accepted(), 3U);
}

TEST_F(UdpDeviceTest, ALongQueueIsDiscardedUntilTheNextState) {
  start();
  peer_->wait_for_states(400);  // a slow start of the loop: the socket's buffer is full
  EXPECT_EQ(device_->read(state_), DeviceStatus::kNoData);
  EXPECT_EQ(state_.t_s, 0);
  ASSERT_EQ(next_state(), DeviceStatus::kOk);
  EXPECT_GT(state_.t_s, 0.4);
}

TEST_F(UdpDeviceTest, AStopInALongQueueIsReported) {
  start(LinkClock::kReal, "stop@0.05");
  peer_->wait_for_states(200);
  EXPECT_EQ(device_->read(state_), DeviceStatus::kEmergencyStop);
}

// 100 states in each tick are usual for this drive, and 150 after a late tick.
TEST_F(UdpDeviceTest, AQueueOfTheStatesOfATickIsNotTooLong) {
  peer_ = std::make_unique<Peer>(LinkClock::kReal, "", 10, 1e-4);
  UdpLinkOptions options = to(*peer_);
  options.period_s = 1e-2;
  connect_to(options);
  ASSERT_EQ(next_state(), DeviceStatus::kOk);
  peer_->wait_for_states(150);
  EXPECT_EQ(device_->read(state_), DeviceStatus::kOk);
  // Twice as many are refused.
  device_.reset();
  peer_ = std::make_unique<Peer>(LinkClock::kReal, "", 10, 5e-5);
  options.peer = peer_->endpoint;
  options.key = peer_->key;
  expect_refused(options, ExitCode::kUsage, "sends 200 states in each tick, and at most 128 can");
}

// SIGUSR1 asks trocar-run for a recovery, and interrupts the thread that waits.
TEST_F(UdpDeviceTest, InLockStepASignalDoesNotEndTheWait) {
  start(LinkClock::kLockStep);
  ASSERT_EQ(device_->read(state_), DeviceStatus::kOk);
  const auto before = std::signal(SIGUSR1, [](int) {});
  peer_->is_slow = true;
  ASSERT_EQ(device_->write({}), DeviceStatus::kOk);
  std::thread signaller([waiting = ::pthread_self()] {
    sleep_ms(20);
    ::pthread_kill(waiting, SIGUSR1);
  });
  EXPECT_TRUE(device_->wait_for_answer());
  signaller.join();
  std::signal(SIGUSR1, before);
  EXPECT_EQ(device_->read(state_), DeviceStatus::kOk);
}

TEST_F(UdpDeviceTest, InvalidTorquesAreNotSent) {
  start(LinkClock::kLockStep);
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity(), 1e4}) {
    DeviceCommand command;
    command.tau_motor_Nm[3] = bad;
    EXPECT_EQ(device_->write(command), DeviceStatus::kNoData);
  }
  EXPECT_EQ(device_->write({}), DeviceStatus::kOk);
}

TEST_F(UdpDeviceTest, ConnectSaysWhyItFails) {
  peer_ = std::make_unique<Peer>(LinkClock::kReal, "", 1000);
  UdpLinkOptions options = to(*peer_, LinkClock::kLockStep);
  expect_refused(options, ExitCode::kUsage, "--clock real");
  options = to(*peer_);
  options.connect_timeout_s = 0.3;
  expect_refused<UdpPoseDevice>(options, ExitCode::kDeviceFault,
                                "it states angles; use --device udp:");
  options.key = random_link_key();
  expect_refused(options, ExitCode::kDeviceFault, "has another key");
  options.key = peer_->key;
  options.connect_timeout_s = 1;
  connect_to(to(*peer_));
  expect_refused(options, ExitCode::kDeviceFault, "in a session with another host");
  device_.reset();
  peer_ = std::make_unique<Peer>(LinkClock::kReal);
  peer_->mute = true;
  options.peer = peer_->endpoint;
  options.key = peer_->key;
  expect_refused(options, ExitCode::kDeviceFault, "sends no states; end another host's session");
  peer_.reset();
  expect_refused(options, ExitCode::kDeviceFault, "nothing listens on this port");
  auto silent = UdpSocket::listen({0x7f000001, 0});
  ASSERT_TRUE(silent);
  options.peer = silent->local();
  expect_refused(options, ExitCode::kDeviceFault, "cannot be reached");
}

TEST_F(UdpDeviceTest, ReadAndWriteAllocateNothing) {
  TROCAR_NEEDS_COUNTED_ALLOCATIONS();
  start();
  const std::uint64_t before = allocations_in_scopes();
  for (int tick = 0; tick < 100; ++tick) {
    {
      const NoAllocationScope scope;
      device_->read(state_);
      device_->write({});
    }
    sleep_ms(1);
  }
  EXPECT_EQ(allocations_in_scopes(), before);
  EXPECT_GT(device_->packets().accepted(), 10U);
}

// At 10 Hz, 30 ms without a state are shorter than a tick.
TEST_F(UdpDeviceTest, AtALowRateATickWithoutAStateIsNoLoss) {
  start_with([](UdpLinkOptions& options) {
    options.no_state_s = 0.01;
    options.period_s = 0.1;
  });
  peer_->mute = true;
  read_until(DeviceStatus::kNoData);
  sleep_ms(30);
  EXPECT_EQ(device_->read(state_), DeviceStatus::kNoData);
}

// restore() must not end a link whose states arrive again.
TEST_F(UdpDeviceTest, ALongQueueAfterALossShowsThatTheLinkWorks) {
  start_with([](UdpLinkOptions& options) { options.no_state_s = 0.3; });
  peer_->mute = true;
  ASSERT_EQ(read_until(DeviceStatus::kLinkLost), DeviceStatus::kLinkLost);
  peer_->mute = false;
  peer_->wait_for_states(400);  // the loop is held up meanwhile
  ASSERT_EQ(device_->read(state_), DeviceStatus::kNoData);
  device_->restore();
  EXPECT_EQ(next_state(), DeviceStatus::kOk);
  EXPECT_EQ(device_->sessions(), 1U);
}

TEST_F(UdpDeviceTest, RestoreDoesNothingWhileTheLinkWorks) {
  start();
  for (int tick = 0; tick < 50; ++tick) {
    ASSERT_EQ(device_->write({}), DeviceStatus::kOk);
    ASSERT_EQ(next_state(), DeviceStatus::kOk);
    device_->restore();
  }
  EXPECT_EQ(device_->sessions(), 1U);
}

TEST_F(UdpDeviceTest, RestoreRetriesWithPausesAndReportsAnotherClock) {
  start();
  peer_.reset();
  ASSERT_EQ(read_until(DeviceStatus::kLinkLost, true), DeviceStatus::kLinkLost);
  restart(LinkClock::kLockStep, 1);
  const auto before = SteadyClock::now();
  device_->restore();
  for (int ms = 0; ms < 5000 && peer_->received < 6; ++ms)
    sleep_ms(1);
  sleep_ms(200);
  device_->close();
  const int received = peer_->received;
  const double tried_s = std::chrono::duration<double>(SteadyClock::now() - before).count();
  EXPECT_GE(received, 6) << "too few attempts";
  EXPECT_LE(received, 2 * (tried_s / 0.05 + 2)) << "more than a stop and a hello per attempt";
  ASSERT_TRUE(device_->restore_error());
  EXPECT_NE(device_->restore_error()->message.find("--clock virtual"), std::string::npos);
}

TEST_F(UdpDeviceTest, InLockStepRestoreWaitsForARestartedDrive) {
  start(LinkClock::kLockStep, "", 10, [](UdpLinkOptions& options) {
    options.answer_s = 0.2;
    options.connect_timeout_s = 2;
  });
  ASSERT_EQ(device_->read(state_), DeviceStatus::kOk);
  const auto lose = [&] {
    peer_.reset();
    device_->write({});
    EXPECT_FALSE(device_->wait_for_answer());
    EXPECT_EQ(device_->read(state_), DeviceStatus::kLinkLost);
    device_->restore();
  };
  lose();
  std::thread later([&] {
    sleep_ms(300);
    restart(LinkClock::kLockStep, 1);
  });
  EXPECT_TRUE(device_->wait_for_answer());
  later.join();
  ASSERT_EQ(device_->read(state_), DeviceStatus::kOk);
  EXPECT_EQ(state_.t_s, 0);
  ASSERT_EQ(answer_to({}), DeviceStatus::kOk);
  EXPECT_NEAR(state_.t_s, 1e-3, 1e-9);
  // Without a restarted drive it gives up: later ticks do not wait.
  lose();
  EXPECT_FALSE(device_->wait_for_answer());
  const auto before = SteadyClock::now();
  for (int tick = 0; tick < 20; ++tick) {
    EXPECT_EQ(device_->read(state_), DeviceStatus::kLinkLost);
    device_->restore();
    device_->write({});
    EXPECT_FALSE(device_->wait_for_answer());
  }
  EXPECT_LT(SteadyClock::now() - before, std::chrono::seconds(2)) << "later ticks wait";
}

}  // namespace
}  // namespace trocar::runtime
