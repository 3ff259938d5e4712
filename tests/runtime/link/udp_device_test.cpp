// SPDX-License-Identifier: Apache-2.0
// The loop's side of the link over real sockets of this machine: accepted and refused packets,
// detection of a lost link, new sessions, and no allocation.
// Long because all tests of this file share its fixtures.
#include "runtime/link/udp_device.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <functional>
#include <limits>
#include <thread>

#include "runtime/link/link_key.h"
#include "runtime/link/udp_pose_device.h"
#include "runtime/realtime/allocation_counter.h"
#include "runtime/simulation/drive.h"
#include "tests/support/counted_allocations.h"

namespace trocar::runtime {
namespace {

using Clock = std::chrono::steady_clock;

SimulatedDevice held_device() {
  HandTrajectory hand;
  hand.keyframes.resize(1);
  hand.keyframes[0].T_device_tool.p_m.z() = 0.15;
  return std::move(*SimulatedDevice::make(default_device_description(), hand, {}));
}

std::int64_t now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now().time_since_epoch())
      .count();
}
void sleep_ms(int ms) {
  std::this_thread::sleep_for(std::chrono::milliseconds(ms));
}

/// A drive on a socket, run by a thread: states every millisecond (whatever period it states), or in
/// lock-step.
class Peer {
 public:
  /// The watchdog's time is long, so that a short stall of this machine does not trip it.
  explicit Peer(LinkClock clock, const char* faults = "", double watchdog_s = 10,
                double period_s = 1e-3)
      : Peer(clock, faults, watchdog_s, {0x7f000001, 0}, random_link_key(), period_s) {}
  /// A drive that was restarted: it has the key and the address of the previous one.
  Peer(LinkClock clock, const char* faults, double watchdog_s, const Endpoint& at,
       const LinkKey& with, double period_s = 1e-3)
      : socket_(std::move(*UdpSocket::listen(at))), key(with) {
    DriveOptions options;
    options.key = key;
    options.clock = clock;
    options.period_s = period_s;
    options.watchdog_s = watchdog_s;
    options.session_s = 1000;
    options.faults = *parse_fault_plan(faults);
    endpoint = socket_.local();
    thread_ = std::thread([this, options] { serve(options); });
  }
  ~Peer() {
    done_ = true;
    thread_.join();
  }
  Peer(const Peer&) = delete;
  Peer& operator=(const Peer&) = delete;

  /// While set, no states are sent; commands are received.
  std::atomic<bool> mute{false};
  /// While set, commands are dropped; states are sent.
  std::atomic<bool> drops_commands{false};
  /// While set, commands are received only after 100 ms.
  std::atomic<bool> is_slow{false};
  /// Datagrams received.
  std::atomic<int> received{0};
  /// Waits until `count` more states have been sent, however long this machine takes for them.
  void wait_for_states(int count) const {
    for (const int until = sent_ + count; sent_ < until;)
      sleep_ms(1);
  }
  /// Called with each state before it is sent, to send more, once `sends_more` is set.
  std::function<void(const Drive::Answer&, UdpSocket&, const Endpoint&)> also;
  std::atomic<bool> sends_more{false};

 private:
  UdpSocket socket_;

 public:
  LinkKey key;
  Endpoint endpoint;

 private:
  void serve(const DriveOptions& options) {
    Drive drive(options, held_device());
    Endpoint host;
    while (!done_) {
      if (socket_.wait(1e-3) && is_slow) sleep_ms(100);
      std::array<std::uint8_t, 512> buffer;
      std::size_t bytes = 0;
      Endpoint from;
      Drive::Answer answer;
      while (socket_.receive(buffer, bytes, from) == UdpSocket::Outcome::kDone) {
        ++received;
        if (drops_commands) continue;
        bool from_host = false;
        drive.receive(std::span(buffer).first(std::min<std::size_t>(bytes, 512)), now_ns(), answer,
                      from_host);
        if (from_host) host = from;
        if (answer.size > 0) socket_.send_to(answer.view(), from);
      }
      if (options.clock == LinkClock::kLockStep) continue;
      drive.tick(now_ns(), 1, answer);
      if (answer.size == 0 || mute) continue;
      if (sends_more) also(answer, socket_, host);
      socket_.send_to(answer.view(), host);
      ++sent_;
    }
  }
  std::atomic<int> sent_{0};
  std::atomic<bool> done_{false};
  std::thread thread_;
};

UdpLinkOptions to(const Peer& peer, LinkClock clock = LinkClock::kReal) {
  UdpLinkOptions options;
  options.peer = peer.endpoint;
  options.key = peer.key;
  options.clock = clock;
  options.connect_timeout_s = 5;
  options.no_state_s = 5;  // longer than this machine ever stalls
  return options;
}

std::unique_ptr<UdpDevice> connected(const UdpLinkOptions& options) {
  auto device = UdpDevice::connect(options);
  EXPECT_TRUE(device) << device.error().message;
  return device ? std::move(*device) : nullptr;
}

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

/// Reads until the status is not kNoData, for at most two seconds.
DeviceStatus next(UdpDevice& device, DeviceState& state) {
  for (int ms = 0; ms < 2000; ++ms) {
    const DeviceStatus status = device.read(state);
    if (status != DeviceStatus::kNoData) return status;
    sleep_ms(1);
  }
  return DeviceStatus::kNoData;
}

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
  const auto device = UdpDevice::connect(options);
  ASSERT_FALSE(device);
  EXPECT_EQ(device.error().code, ExitCode::kUsage);
  EXPECT_NE(device.error().message.find("sends 200 states in each tick, and at most 128 can"),
            std::string::npos)
      << device.error().message;
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
  const auto quiet = Clock::now();
  const DeviceState before = state;
  for (int ms = 0; ms < 5000 && status == DeviceStatus::kNoData; ++ms) {
    sleep_ms(1);
    status = device->read(state);
  }
  EXPECT_EQ(status, DeviceStatus::kLinkLost);
  EXPECT_GT(Clock::now() - quiet, std::chrono::milliseconds(150));
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
  const auto before = Clock::now();
  device->restore();
  for (int ms = 0; ms < 5000 && other.received < 6; ++ms)
    sleep_ms(1);
  sleep_ms(200);
  device->close();
  const int received = other.received;
  const double tried_s = std::chrono::duration<double>(Clock::now() - before).count();
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
  const auto before = Clock::now();
  for (int tick = 0; tick < 20; ++tick) {
    EXPECT_EQ(device->read(state), DeviceStatus::kLinkLost);
    device->restore();
    device->write({});
    EXPECT_FALSE(device->wait_for_answer());
  }
  EXPECT_LT(Clock::now() - before, std::chrono::seconds(2)) << "later ticks wait";
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
  auto wrong_clock = UdpDevice::connect(options);
  ASSERT_FALSE(wrong_clock);
  EXPECT_EQ(wrong_clock.error().code, ExitCode::kUsage);
  EXPECT_NE(wrong_clock.error().message.find("--clock real"), std::string::npos);
  options = to(peer);
  options.key = random_link_key();
  options.connect_timeout_s = 0.2;
  auto wrong_key = UdpDevice::connect(options);
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
    const auto none = UdpDevice::connect(options);
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
