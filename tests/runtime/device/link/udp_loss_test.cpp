// SPDX-License-Identifier: Apache-2.0
// The loop's side of the link over real sockets of this machine: when the link counts as lost, and
// new sessions after a loss. udp_device_test.cpp has the packets and connecting.
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <thread>

#include "runtime/device/link/udp_link.h"
#include "tests/runtime/device/link/udp_peer.h"

namespace trocar::runtime {
namespace {

using namespace testing_support;
using SteadyClock = std::chrono::steady_clock;

/// Behaves like a recovering loop: calls restore() in each tick until read() returns kOk, for at
/// most five seconds. Returns the last status.
DeviceStatus restored(UdpDevice& device, DeviceState& state) {
  DeviceStatus status = DeviceStatus::kLinkLost;
  for (int ms = 0; ms < 5000; ++ms) {
    status = device.read(state);
    if (status == DeviceStatus::kOk) break;
    if (status != DeviceStatus::kNoData) device.restore();
    device.write({});
    sleep_ms(1);
  }
  return status;
}

// At 10 Hz, 30 ms without a state are shorter than a tick.
TEST(UdpDevice, AtALowRateATickWithoutAStateIsNoLoss) {
  Peer peer(LinkClock::kReal);
  UdpLinkOptions options = to(peer);
  options.no_state_s = 0.01;
  options.period_s = 0.1;
  const auto device = connected(options);
  ASSERT_TRUE(device);
  peer.mute = true;
  DeviceState state;
  while (device->read(state) == DeviceStatus::kOk) {
  }
  sleep_ms(30);
  EXPECT_EQ(device->read(state), DeviceStatus::kNoData);
}

// restore() must not end a link whose states arrive again.
TEST(UdpDevice, ALongQueueAfterALossShowsThatTheLinkWorks) {
  Peer peer(LinkClock::kReal);
  UdpLinkOptions options = to(peer);
  options.no_state_s = 0.3;
  const auto device = connected(options);
  ASSERT_TRUE(device);
  peer.mute = true;
  DeviceState state;
  DeviceStatus status = DeviceStatus::kOk;
  for (int ms = 0; ms < 5000 && status != DeviceStatus::kLinkLost; ++ms) {
    sleep_ms(1);
    status = device->read(state);
  }
  ASSERT_EQ(status, DeviceStatus::kLinkLost);
  peer.mute = false;
  peer.wait_for_states(400);  // the loop is held up meanwhile
  ASSERT_EQ(device->read(state), DeviceStatus::kNoData);
  device->restore();
  EXPECT_EQ(next(*device, state), DeviceStatus::kOk);
  EXPECT_EQ(device->sessions(), 1U);
}

TEST(UdpDevice, LinkIsLostAfterTheTimeoutWithoutStates) {
  Peer peer(LinkClock::kReal);
  UdpLinkOptions options = to(peer);
  options.no_state_s = 0.3;
  const auto device = connected(options);
  ASSERT_TRUE(device);
  peer.mute = true;
  sleep_ms(5);
  DeviceState state;
  state.t_s = -1;
  DeviceStatus status = DeviceStatus::kOk;
  while (status == DeviceStatus::kOk)
    status = device->read(state);
  const auto quiet = SteadyClock::now();
  const DeviceState before = state;
  for (int ms = 0; ms < 5000 && status == DeviceStatus::kNoData; ++ms) {
    sleep_ms(1);
    status = device->read(state);
  }
  EXPECT_EQ(status, DeviceStatus::kLinkLost);
  EXPECT_GT(SteadyClock::now() - quiet, std::chrono::milliseconds(150));
  EXPECT_EQ(state.t_s, before.t_s);
  EXPECT_EQ(state.encoder_rad, before.encoder_rad) << "the state changed without a new one";
  // A new session with the same drive, in the same world.
  peer.mute = false;
  ASSERT_EQ(restored(*device, state), DeviceStatus::kOk);
  EXPECT_GT(state.t_s, before.t_s);
}

TEST(UdpDevice, RestoreDoesNothingWhileTheLinkWorks) {
  Peer peer(LinkClock::kReal);
  const auto device = connected(to(peer));
  ASSERT_TRUE(device);
  DeviceState state;
  for (int tick = 0; tick < 50; ++tick) {
    ASSERT_EQ(device->write({}), DeviceStatus::kOk);
    ASSERT_EQ(next(*device, state), DeviceStatus::kOk);
    device->restore();
  }
  EXPECT_EQ(device->sessions(), 1U);
}

TEST(UdpDevice, RestoreConnectsToARestartedDrive) {
  auto peer = std::make_unique<Peer>(LinkClock::kReal);
  const Endpoint at = peer->endpoint;
  const LinkKey key = peer->key;
  UdpLinkOptions options = to(*peer);
  options.no_state_s = 0.05;
  options.connect_timeout_s = 0.1;  // one attempt of many
  const auto device = connected(options);
  ASSERT_TRUE(device);
  DeviceState state;
  ASSERT_EQ(device->write({}), DeviceStatus::kOk);
  peer.reset();
  DeviceStatus status = DeviceStatus::kOk;
  for (int ms = 0; ms < 3000 && status != DeviceStatus::kLinkLost; ++ms) {
    device->write({});
    status = device->read(state);
    sleep_ms(1);
  }
  ASSERT_EQ(status, DeviceStatus::kLinkLost);
  device->restore();
  for (int ms = 0; ms < 300; ms += 10) {  // no drive is running yet
    ASSERT_EQ(device->read(state), DeviceStatus::kLinkLost);
    ASSERT_EQ(device->write({}), DeviceStatus::kLinkLost);
    device->restore();
    sleep_ms(10);
  }
  Peer again(LinkClock::kReal, "", 10, at, key);
  EXPECT_EQ(restored(*device, state), DeviceStatus::kOk);
  EXPECT_EQ(device->sessions(), 2U);
  EXPECT_LT(state.t_s, 1) << "the simulated world did not start again";
  ASSERT_EQ(device->write({}), DeviceStatus::kOk);
  EXPECT_EQ(next(*device, state), DeviceStatus::kOk);
}

TEST(UdpDevice, RestoreRetriesWithPausesAndReportsAnotherClock) {
  auto peer = std::make_unique<Peer>(LinkClock::kReal);
  const auto device = connected(to(*peer));
  ASSERT_TRUE(device);
  const Endpoint at = peer->endpoint;
  const LinkKey key = peer->key;
  peer.reset();
  DeviceState state;
  DeviceStatus status = DeviceStatus::kOk;
  for (int ms = 0; ms < 5000 && status != DeviceStatus::kLinkLost; ++ms) {
    device->write({});
    status = device->read(state);
    sleep_ms(1);
  }
  ASSERT_EQ(status, DeviceStatus::kLinkLost);
  Peer other(LinkClock::kLockStep, "", 1, at, key);
  const auto before = SteadyClock::now();
  device->restore();
  for (int ms = 0; ms < 5000 && other.received < 6; ++ms)
    sleep_ms(1);
  sleep_ms(200);
  device->close();
  const int received = other.received;
  const double tried_s = std::chrono::duration<double>(SteadyClock::now() - before).count();
  EXPECT_GE(received, 6) << "too few attempts";
  EXPECT_LE(received, 2 * (tried_s / 0.05 + 2)) << "more than a stop and a hello per attempt";
  ASSERT_TRUE(device->restore_error());
  EXPECT_NE(device->restore_error()->message.find("--clock virtual"), std::string::npos);
}

TEST(UdpDevice, InLockStepRestoreWaitsForARestartedDrive) {
  auto peer = std::make_unique<Peer>(LinkClock::kLockStep);
  const Endpoint at = peer->endpoint;
  const LinkKey key = peer->key;
  UdpLinkOptions options = to(*peer, LinkClock::kLockStep);
  options.answer_s = 0.2;
  options.connect_timeout_s = 2;
  const auto device = connected(options);
  ASSERT_TRUE(device);
  DeviceState state;
  ASSERT_EQ(device->read(state), DeviceStatus::kOk);
  const auto lose = [&] {
    peer.reset();
    device->write({});
    EXPECT_FALSE(device->wait_for_answer());
    EXPECT_EQ(device->read(state), DeviceStatus::kLinkLost);
    device->restore();
  };
  lose();
  std::thread later([&] {
    sleep_ms(300);
    peer = std::make_unique<Peer>(LinkClock::kLockStep, "", 1, at, key);
  });
  EXPECT_TRUE(device->wait_for_answer());
  later.join();
  ASSERT_EQ(device->read(state), DeviceStatus::kOk);
  EXPECT_EQ(state.t_s, 0);
  ASSERT_EQ(device->write({}), DeviceStatus::kOk);
  ASSERT_TRUE(device->wait_for_answer());
  ASSERT_EQ(device->read(state), DeviceStatus::kOk);
  EXPECT_NEAR(state.t_s, 1e-3, 1e-9);
  // Without a restarted drive it gives up: later ticks do not wait.
  lose();
  EXPECT_FALSE(device->wait_for_answer());
  const auto before = SteadyClock::now();
  for (int tick = 0; tick < 20; ++tick) {
    EXPECT_EQ(device->read(state), DeviceStatus::kLinkLost);
    device->restore();
    device->write({});
    EXPECT_FALSE(device->wait_for_answer());
  }
  EXPECT_LT(SteadyClock::now() - before, std::chrono::seconds(2)) << "later ticks wait";
}

TEST(UdpDevice, AMotorFaultLastsUntilTheNextSession) {
  Peer peer(LinkClock::kReal, "dead:2@0.02..0.2");
  const auto device = connected(to(peer));
  ASSERT_TRUE(device);
  DeviceState state;
  DeviceCommand command;
  command.tau_motor_Nm.fill(1);
  DeviceStatus status = DeviceStatus::kOk;
  for (int ms = 0; ms < 3000 && status == DeviceStatus::kOk; ++ms) {
    device->write(command);
    status = next(*device, state);
  }
  ASSERT_EQ(status, DeviceStatus::kMotorFault);
  for (int ms = 0; ms < 400; ++ms) {  // the motor works again, but the fault stays
    device->write({});
    status = next(*device, state);
  }
  ASSERT_EQ(status, DeviceStatus::kMotorFault);
  EXPECT_EQ(restored(*device, state), DeviceStatus::kOk);
  EXPECT_EQ(device->sessions(), 2U);
}

/// Number of torque commands until the link is lost, to a peer that drops all but the first.
int commands_until_lost(Peer& peer, const UdpLinkOptions& options, int most) {
  const auto device = connected(options);
  if (!device) return -1;
  DeviceState state;
  EXPECT_EQ(device->write({}), DeviceStatus::kOk);
  sleep_ms(30);
  next(*device, state);
  peer.drops_commands = true;
  for (int sent = 1; sent <= most; ++sent) {
    EXPECT_EQ(device->write({}), DeviceStatus::kOk);
    sleep_ms(1);
    if (device->read(state) == DeviceStatus::kLinkLost) return sent;
  }
  return most + 1;
}

TEST(UdpDevice, LinkIsLostIfTheDriveReceivesNoCommands) {
  Peer patient(LinkClock::kReal, "", 1000);
  UdpLinkOptions options = to(patient);
  options.no_state_s = 0.4;
  options.period_s = 1e-3;
  const int until = commands_until_lost(patient, options, 3000);
  EXPECT_GE(until, 200) << "lost before 400 ms of commands were dropped";
  EXPECT_LE(until, 3000);
}

TEST(UdpDevice, LinkIsLostIfTheWatchdogTrips) {
  Peer peer(LinkClock::kReal, "", 0.01);
  UdpLinkOptions options = to(peer);
  options.no_state_s = 10;
  EXPECT_LE(commands_until_lost(peer, options, 2000), 2000);
}

TEST(UdpDevice, AClosedPortIsReportedAtOnce) {
  auto peer = std::make_unique<Peer>(LinkClock::kReal);
  UdpLinkOptions options = to(*peer);
  options.no_state_s = 1000;
  const auto device = connected(options);
  ASSERT_TRUE(device);
  peer.reset();
  DeviceState state;
  while (device->read(state) == DeviceStatus::kOk) {
  }
  device->write({});
  sleep_ms(20);
  const bool lost = device->read(state) == DeviceStatus::kLinkLost ||
                    device->write({}) == DeviceStatus::kLinkLost;
  EXPECT_TRUE(lost);
}

}  // namespace
}  // namespace trocar::runtime
