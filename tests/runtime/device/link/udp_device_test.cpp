// SPDX-License-Identifier: Apache-2.0
// The loop's side of the link over real sockets of this machine: accepted and refused packets,
// connecting, and no allocation. udp_loss_test.cpp has the loss of the link.
#include "runtime/device/link/udp_link.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <csignal>
#include <limits>
#include <memory>
#include <string>
#include <thread>
#include <utility>

#include "runtime/realtime/realtime_thread.h"
#include "tests/runtime/device/link/udp_peer.h"
#include "tests/support/counted_allocations.h"

namespace trocar::runtime {
namespace {

using namespace testing_support;

TEST(UdpDevice, ReceivesStatesAndSendsTorques) {
  Peer peer(LinkClock::kReal);
  const auto device = connected(to(peer));
  ASSERT_TRUE(device);
  DeviceState state;
  DeviceState expected;
  held_device().read(expected);
  ASSERT_EQ(device->read(state), DeviceStatus::kOk) << "no state after connect()";
  EXPECT_EQ(state.encoder_rad, expected.encoder_rad);
  for (int tick = 0; tick < 50; ++tick) {
    DeviceCommand command;
    command.tau_motor_Nm.fill(0.2);
    ASSERT_EQ(device->write(command), DeviceStatus::kOk);
    const double before_s = state.t_s;
    ASSERT_EQ(next(*device, state), DeviceStatus::kOk);
    EXPECT_GT(state.t_s, before_s);
  }
  EXPECT_NE(state.encoder_rad, expected.encoder_rad) << "the torques did not move the device";
  EXPECT_EQ(device->packets().refused(), 0U);
  // A round trip belongs to a command, and two commands that one state acknowledges count once.
  const Histogram round_trip = device->link_report()->round_trip;
  EXPECT_GT(round_trip.samples(), 10U);
  EXPECT_LE(round_trip.samples(), 51U) << "one command of connect(), and 50 others";
  EXPECT_GT(round_trip.quantile_us(0.5), 0);
}

TEST(UdpDevice, ReadGivesTheNewestOfSeveralStates) {
  Peer peer(LinkClock::kReal);
  const auto device = connected(to(peer));
  ASSERT_TRUE(device);
  DeviceState state, last;
  next(*device, state);
  peer.wait_for_states(10);
  ASSERT_EQ(device->read(last), DeviceStatus::kOk);
  EXPECT_GT(last.t_s, state.t_s + 9e-3);
  EXPECT_GT(device->packets().accepted(), 3U);
}

TEST(UdpDevice, ALongQueueIsDiscardedUntilTheNextState) {
  Peer peer(LinkClock::kReal);
  const auto device = connected(to(peer));
  ASSERT_TRUE(device);
  peer.wait_for_states(400);  // a slow start of the loop: the socket's buffer is full
  DeviceState state;
  EXPECT_EQ(device->read(state), DeviceStatus::kNoData);
  EXPECT_EQ(state.t_s, 0);
  ASSERT_EQ(next(*device, state), DeviceStatus::kOk);
  EXPECT_GT(state.t_s, 0.4);
}

TEST(UdpDevice, AStopInALongQueueIsReported) {
  Peer peer(LinkClock::kReal, "stop@0.05");
  const auto device = connected(to(peer));
  ASSERT_TRUE(device);
  peer.wait_for_states(200);
  DeviceState state;
  EXPECT_EQ(device->read(state), DeviceStatus::kEmergencyStop);
}

// 100 states in each tick are usual for this drive, and 150 after a late tick.
TEST(UdpDevice, AQueueOfTheStatesOfATickIsNotTooLong) {
  Peer peer(LinkClock::kReal, "", 10, 1e-4);
  UdpLinkOptions options = to(peer);
  options.period_s = 1e-2;
  const auto device = connected(options);
  ASSERT_TRUE(device);
  DeviceState state;
  ASSERT_EQ(next(*device, state), DeviceStatus::kOk);
  peer.wait_for_states(150);
  EXPECT_EQ(device->read(state), DeviceStatus::kOk);
}

TEST(UdpDevice, ADriveWithMoreStatesThanCanBeReadIsRefused) {
  Peer peer(LinkClock::kReal, "", 10, 5e-5);
  UdpLinkOptions options = to(peer);
  options.period_s = 1e-2;
  const auto device = connect(options);
  ASSERT_FALSE(device);
  EXPECT_EQ(device.error().code, ExitCode::kUsage);
  EXPECT_NE(device.error().message.find("sends 200 states in each tick, and at most 128 can"),
            std::string::npos)
      << device.error().message;
}

TEST(UdpDevice, InLockStepEachWriteIsAnswered) {
  Peer peer(LinkClock::kLockStep);
  const auto device = connected(to(peer, LinkClock::kLockStep));
  ASSERT_TRUE(device);
  SimulatedDevice twin = held_device();
  DeviceState state, expected;
  ASSERT_EQ(device->read(state), DeviceStatus::kOk);
  for (int tick = 0; tick < 100; ++tick) {
    DeviceCommand command;
    command.tau_motor_Nm.fill(0.01 * tick);
    ASSERT_EQ(device->write(command), DeviceStatus::kOk);
    ASSERT_TRUE(device->wait_for_answer());
    twin.write(command);
    twin.step(1e-3);
    twin.read(expected);
    ASSERT_EQ(device->read(state), DeviceStatus::kOk);
    ASSERT_EQ(state.encoder_rad, expected.encoder_rad);
  }
  EXPECT_EQ(device->link_report()->round_trip.samples(), 0U) << "time that is not the wall clock's";
}

// SIGUSR1 asks trocar-run for a recovery, and interrupts the thread that waits.
TEST(UdpDevice, InLockStepASignalDoesNotEndTheWait) {
  Peer peer(LinkClock::kLockStep);
  const auto device = connected(to(peer, LinkClock::kLockStep));
  ASSERT_TRUE(device);
  DeviceState state;
  ASSERT_EQ(device->read(state), DeviceStatus::kOk);
  const auto before = std::signal(SIGUSR1, [](int) {});
  peer.is_slow = true;
  ASSERT_EQ(device->write({}), DeviceStatus::kOk);
  std::thread signaller([waiting = ::pthread_self()] {
    sleep_ms(20);
    ::pthread_kill(waiting, SIGUSR1);
  });
  EXPECT_TRUE(device->wait_for_answer());
  signaller.join();
  std::signal(SIGUSR1, before);
  EXPECT_EQ(device->read(state), DeviceStatus::kOk);
}

TEST(UdpDevice, ReportsEmergencyStopAndMotorFault) {
  for (const auto& [faults, wanted] : {std::pair{"stop@0.02", DeviceStatus::kEmergencyStop},
                                       std::pair{"dead:2@0.02", DeviceStatus::kMotorFault}}) {
    Peer peer(LinkClock::kLockStep, faults);
    const auto device = connected(to(peer, LinkClock::kLockStep));
    ASSERT_TRUE(device);
    DeviceState state;
    DeviceCommand command;
    command.tau_motor_Nm.fill(1);
    DeviceStatus status = device->read(state);
    int tick = 0;
    for (; tick < 60 && status == DeviceStatus::kOk; ++tick) {
      ASSERT_EQ(device->write(command), DeviceStatus::kOk);
      ASSERT_TRUE(device->wait_for_answer());
      status = device->read(state);
    }
    EXPECT_EQ(status, wanted);
    EXPECT_GE(tick, 20);
    EXPECT_LE(tick, 28);
  }
}

TEST(UdpDevice, InvalidAndReplayedPacketsAreOnlyCounted) {
  Peer peer(LinkClock::kReal);
  Drive::Answer first;
  peer.also = [&](const Drive::Answer& state, UdpSocket& socket, const Endpoint& host) {
    if (first.size == 0) first = state;
    Drive::Answer changed = state;
    changed.bytes[60] ^= 4;
    std::array<std::uint8_t, 400> large{};
    socket.send_to(first.view(), host);               // replayed
    socket.send_to(changed.view(), host);             // a bit changed
    socket.send_to(state.view().first(100), host);    // truncated
    socket.send_to(std::span(large).first(0), host);  // empty
    socket.send_to(large, host);
  };
  peer.sends_more = true;
  const auto device = connected(to(peer));
  ASSERT_TRUE(device);
  DeviceState state;
  double last_s = -1;
  for (int tick = 0; tick < 40; ++tick) {
    ASSERT_EQ(device->write({}), DeviceStatus::kOk);
    ASSERT_EQ(next(*device, state), DeviceStatus::kOk);
    EXPECT_GT(state.t_s, last_s);
    last_s = state.t_s;
  }
  const auto& counts = device->packets().by_refusal;
  EXPECT_GT(counts[static_cast<std::size_t>(LinkRefusal::kSequence)], 10U);
  EXPECT_GT(counts[static_cast<std::size_t>(LinkRefusal::kMac)], 10U);
  EXPECT_GT(counts[static_cast<std::size_t>(LinkRefusal::kSize)], 30U);
}

TEST(UdpDevice, InvalidTorquesAreNotSent) {
  Peer peer(LinkClock::kLockStep);
  const auto device = connected(to(peer, LinkClock::kLockStep));
  ASSERT_TRUE(device);
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity(), 1e4}) {
    DeviceCommand command;
    command.tau_motor_Nm[3] = bad;
    EXPECT_EQ(device->write(command), DeviceStatus::kNoData);
  }
  EXPECT_EQ(device->write({}), DeviceStatus::kOk);
}

TEST(UdpDevice, ConnectNamesTheWrongClockAndTheWrongKey) {
  Peer peer(LinkClock::kReal);
  UdpLinkOptions options = to(peer, LinkClock::kLockStep);
  auto wrong_clock = connect(options);
  ASSERT_FALSE(wrong_clock);
  EXPECT_EQ(wrong_clock.error().code, ExitCode::kUsage);
  EXPECT_NE(wrong_clock.error().message.find("--clock real"), std::string::npos);
  options = to(peer);
  options.key = random_link_key();
  options.connect_timeout_s = 0.2;
  auto wrong_key = connect(options);
  ASSERT_FALSE(wrong_key);
  EXPECT_EQ(wrong_key.error().code, ExitCode::kDeviceFault);
  EXPECT_NE(wrong_key.error().message.find("has another key"), std::string::npos)
      << wrong_key.error().message;
}

TEST(UdpDevice, AHostForPosesLearnsThatTheDriveStatesAngles) {
  Peer peer(LinkClock::kReal);
  UdpLinkOptions options = to(peer);
  options.connect_timeout_s = 0.3;
  auto other = UdpPoseDevice::make(options);
  ASSERT_TRUE(other);
  const Result<void> started = (*other)->start();
  ASSERT_FALSE(started);
  EXPECT_EQ(started.error().code, ExitCode::kDeviceFault);
  EXPECT_NE(started.error().message.find("it states angles; use --device udp:"), std::string::npos)
      << started.error().message;
}

TEST(UdpDevice, ConnectTellsABusyDeviceFromOneThatIsNotThere) {
  const auto why = [](const UdpLinkOptions& options) {
    const auto none = connect(options);
    EXPECT_FALSE(none);
    return none ? std::string() : none.error().message;
  };
  auto peer = std::make_unique<Peer>(LinkClock::kReal, "", 1000);
  UdpLinkOptions options = to(*peer);
  options.connect_timeout_s = 1;
  {
    const auto first = connected(to(*peer));
    ASSERT_TRUE(first);
    EXPECT_NE(why(options).find("in a session with another host"), std::string::npos);
  }
  peer = std::make_unique<Peer>(LinkClock::kReal);
  peer->mute = true;
  options.peer = peer->endpoint;
  options.key = peer->key;
  EXPECT_NE(why(options).find("sends no states; end another host's session"), std::string::npos);
  peer.reset();
  EXPECT_NE(why(options).find("nothing listens on this port"), std::string::npos);
  auto silent = UdpSocket::listen({0x7f000001, 0});
  ASSERT_TRUE(silent);
  options.peer = silent->local();
  EXPECT_NE(why(options).find("cannot be reached"), std::string::npos);
}

TEST(UdpDevice, ReadAndWriteAllocateNothing) {
  TROCAR_NEEDS_COUNTED_ALLOCATIONS();
  Peer peer(LinkClock::kReal);
  const auto device = connected(to(peer));
  ASSERT_TRUE(device);
  DeviceState state;
  const std::uint64_t before = allocations_in_scopes();
  for (int tick = 0; tick < 100; ++tick) {
    {
      const NoAllocationScope scope;
      device->read(state);
      device->write({});
    }
    sleep_ms(1);
  }
  EXPECT_EQ(allocations_in_scopes(), before);
  EXPECT_GT(device->packets().accepted(), 10U);
}

}  // namespace
}  // namespace trocar::runtime
