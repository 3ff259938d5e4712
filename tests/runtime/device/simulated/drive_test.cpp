// SPDX-License-Identifier: Apache-2.0
// The drive's side of the link, datagram by datagram, with the test's clock: sessions, refused
// packets, when torques are zero, and the injected faults.
// Long because all tests of this file share its fixtures.
#include "runtime/device/simulated/drive.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <optional>
#include <random>
#include <vector>

#include "tests/support/campaign.h"

namespace trocar::runtime {
namespace {

constexpr std::int64_t kMs = 1'000'000;
using Bytes = std::vector<std::uint8_t>;

SimulatedDevice slowly_lowered_device() {
  HandTrajectory hand;
  hand.keyframes.resize(2);
  hand.keyframes[0].T_device_tool.p_m.z() = 0.15;
  hand.keyframes[1].t_s = 1;
  hand.keyframes[1].T_device_tool.p_m.z() = 0.14;
  auto made = SimulatedDevice::make(default_device_description(), hand, {});
  EXPECT_TRUE(made);
  return std::move(*made);
}

/// A host in the test. It keeps its last packets, so that they can be sent again.
class Host {
 public:
  explicit Host(Drive& drive, const LinkKey& key) : drive_(drive), key_(key) {}

  /// False: no welcome.
  bool handshake(std::int64_t now_ns, bool resets_world = true, double period_s = 1e-3) {
    HelloPacket hello;
    hello.host_nonce = random_nonce();
    hello.period_s = period_s;
    hello.resets_world = resets_world;
    hello_.resize(kMaxPacketBytes);
    hello_.resize(encode(hello, key_, hello_));
    if (send(hello_, now_ns) != LinkRefusal::kNone) return false;
    WelcomePacket welcome;
    EXPECT_EQ(decode(answer_.view(), key_, hello.host_nonce, welcome), LinkRefusal::kNone);
    session_key_ = session_key(key_, hello.host_nonce, welcome.drive_nonce);
    session_ = session_number(welcome.drive_nonce);
    sequence_ = last_state_ = 0;
    return true;
  }
  LinkRefusal command(CommandMode mode, double tau_Nm, std::int64_t now_ns) {
    CommandPacket packet;
    packet.session = session_;
    packet.sequence = ++sequence_;
    packet.mode = mode;
    packet.state_seen = last_state_;
    packet.tau_motor_Nm.fill(tau_Nm);
    sent_.resize(kMaxPacketBytes);
    sent_.resize(encode(packet, session_key_, sent_));
    return send(sent_, now_ns);
  }
  LinkRefusal torque(double tau_Nm, std::int64_t now_ns) {
    return command(CommandMode::kTorque, tau_Nm, now_ns);
  }
  LinkRefusal send(const Bytes& bytes, std::int64_t now_ns) {
    return drive_.receive(bytes, now_ns, answer_, from_host_);
  }
  /// The state in the drive's last answer.
  StatePacket state() { return state_in(answer_); }
  StatePacket state_in(const Drive::Answer& answer) {
    StatePacket state;
    EXPECT_EQ(decode(answer.view(), session_key_, session_, last_state_, state),
              LinkRefusal::kNone);
    return state;
  }
  const Bytes& sent() const { return sent_; }
  const Bytes& hello() const { return hello_; }
  std::span<const std::uint8_t> answer() const { return answer_.view(); }
  bool was_answered() const { return answer_.size > 0; }
  /// The reason of the denial in the drive's last answer; none: it is none.
  std::optional<DenialReason> denial() const {
    LinkNonce nonce{};
    DenialPacket denial;
    if (!hello_nonce(hello_, nonce)) return std::nullopt;
    if (decode(answer_.view(), nonce, denial) != LinkRefusal::kNone) return std::nullopt;
    return denial.reason;
  }
  bool from_host() const { return from_host_; }

 private:
  Drive& drive_;
  LinkKey key_;
  LinkKey session_key_;
  std::uint64_t session_ = 0, sequence_ = 0, last_state_ = 0;
  Bytes hello_, sent_;
  Drive::Answer answer_;
  bool from_host_ = false;
};

class DriveLink : public testing::Test {
 protected:
  void SetUp() override { ASSERT_TRUE(start_link()); }
  DriveOptions options(LinkClock clock, const char* faults = "") {
    DriveOptions o;
    o.key = key_;
    o.clock = clock;
    auto plan = parse_fault_plan(faults);
    EXPECT_TRUE(plan) << plan.error().message;
    o.faults = *plan;
    return o;
  }
  LinkKey key_ = random_link_key();
};

double torque_of(const Drive& drive) {
  return drive.model().truth().tau_motor_Nm.cwiseAbs().maxCoeff();
}

TEST_F(DriveLink, InLockStepOnlyTorqueCommandsAdvanceTime) {
  Drive drive(options(LinkClock::kLockStep), slowly_lowered_device());
  Host host(drive, key_);
  ASSERT_TRUE(host.handshake(0, true, 2e-3));
  EXPECT_FALSE(drive.in_session()) << "a welcome began the session";
  ASSERT_EQ(host.command(CommandMode::kFree, 0, 0), LinkRefusal::kNone);
  EXPECT_TRUE(drive.in_session());
  EXPECT_TRUE(host.from_host());
  EXPECT_EQ(host.state().time_ns, 0);
  SimulatedDevice twin = slowly_lowered_device();
  for (int tick = 1; tick <= 50; ++tick) {
    ASSERT_EQ(host.torque(0.5, 0), LinkRefusal::kNone);
    DeviceCommand command;
    command.tau_motor_Nm.fill(0.5);
    twin.write(command);
    twin.step(2e-3);
    DeviceState expected;
    twin.read(expected);
    const StatePacket state = host.state();
    ASSERT_EQ(state.encoder_rad, expected.encoder_rad) << "bit for bit, tick " << tick;
    EXPECT_EQ(state.time_ns, std::llround(expected.t_s * 1e9));
    EXPECT_EQ(state.command_taken, static_cast<std::uint64_t>(tick) + 1);
    EXPECT_EQ(state.mode, DriveMode::kTorque);
    EXPECT_EQ(host.send(host.sent(), 0), LinkRefusal::kSequence);
    EXPECT_FALSE(host.was_answered());
  }
  EXPECT_NEAR(drive.session_time_s(), 0.1, 1e-12);
  ASSERT_EQ(host.command(CommandMode::kFree, 0, 0), LinkRefusal::kNone);
  EXPECT_NEAR(drive.session_time_s(), 0.1, 1e-12);
  EXPECT_EQ(host.state().mode, DriveMode::kReady);
}

TEST_F(DriveLink, DelayedDriveCatchesUpWithItsOldCommandAndItsWatchdog) {
  DriveOptions delayed = options(LinkClock::kReal);
  delayed.record_steps = 1000;
  Drive drive(delayed, slowly_lowered_device());
  Host host(drive, key_);
  Drive::Answer state;
  ASSERT_TRUE(host.handshake(0));
  ASSERT_EQ(host.torque(1, 0), LinkRefusal::kNone);
  drive.tick(0, 1, state);
  // The process sleeps from 0 to 20 ms; a command came meanwhile.
  drive.catch_up(20 * kMs, 80);
  ASSERT_EQ(host.torque(0.5, 20 * kMs), LinkRefusal::kNone);
  drive.tick(20 * kMs + kMs / 4, 1, state);
  ASSERT_EQ(drive.report().steps.size(), 82U);
  for (std::size_t i = 0; i < 82; ++i) {
    const DriveStep& step = drive.report().steps[i];
    EXPECT_EQ(step.mode, i <= 40 ? DriveMode::kTorque : DriveMode::kWatchdog) << i;
    EXPECT_EQ(step.applied_max_Nm, i <= 40 ? 1 : 0) << i;
    EXPECT_EQ(step.command_taken, i <= 80 ? 1U : 2U) << i;
  }
  EXPECT_EQ(host.state_in(state).mode, DriveMode::kWatchdog);
  EXPECT_EQ(drive.report().watchdog_trips, 1U);
}

TEST_F(DriveLink, WatchdogZeroesTorquesUntilTheHostAcknowledges) {
  Drive drive(options(LinkClock::kReal), slowly_lowered_device());
  Host host(drive, key_);
  Drive::Answer state;
  drive.tick(0, 1, state);
  EXPECT_EQ(state.size, 0U) << "a state without a session";
  ASSERT_TRUE(host.handshake(0));
  ASSERT_EQ(host.torque(1, 0), LinkRefusal::kNone);
  EXPECT_FALSE(host.was_answered()) << "a state outside of the drive's clock";
  for (std::int64_t ms = 0; ms <= 10; ++ms) {
    drive.tick(ms * kMs, 4, state);
    EXPECT_EQ(host.state_in(state).mode, DriveMode::kTorque);
    EXPECT_EQ(torque_of(drive), 1) << ms;
  }
  drive.tick(10 * kMs + 1, 1, state);
  EXPECT_EQ(host.state_in(state).mode, DriveMode::kWatchdog);
  EXPECT_EQ(torque_of(drive), 0);
  EXPECT_EQ(drive.report().watchdog_trips, 1U);
  // A repeated command is refused.
  EXPECT_EQ(host.send(host.sent(), 12 * kMs), LinkRefusal::kSequence);
  drive.tick(12 * kMs, 1, state);
  EXPECT_EQ(torque_of(drive), 0);
  ASSERT_EQ(host.torque(0, 13 * kMs), LinkRefusal::kNone);
  ASSERT_EQ(host.torque(0.5, 13 * kMs), LinkRefusal::kNone);
  drive.tick(13 * kMs, 1, state);
  EXPECT_EQ(torque_of(drive), 0.5);
  // After a second without a command the session is over.
  drive.tick(1014 * kMs, 1, state);
  EXPECT_EQ(state.size, 0U);
  EXPECT_EQ(host.torque(0.5, 1015 * kMs), LinkRefusal::kSession);
  drive.tick(1016 * kMs, 1, state);
  EXPECT_EQ(torque_of(drive), 0);
}

TEST_F(DriveLink, DelayedCommandsDoNotBringTheTorquesBack) {
  for (const char* faults : {"", "stop@0.03..0.031"}) {
    Drive drive(options(LinkClock::kReal, faults), slowly_lowered_device());
    Host host(drive, key_);
    Drive::Answer state;
    ASSERT_TRUE(host.handshake(0));
    std::int64_t ms = 0;
    for (; ms < 20; ++ms) {
      ASSERT_EQ(host.torque(1, ms * kMs), LinkRefusal::kNone);
      drive.tick(ms * kMs, 4, state);
      host.state_in(state);
    }
    ASSERT_EQ(torque_of(drive), 1);
    // No command until the watchdog trips; or an emergency stop, pressed and released. The host
    // receives no state of it, and its delayed commands arrive afterwards.
    const bool by_watchdog = faults[0] == 0;
    for (; ms < 40; ++ms) {
      if (!by_watchdog) host.torque(1, ms * kMs);
      drive.tick(ms * kMs, 4, state);
    }
    const DriveMode reported = by_watchdog ? DriveMode::kWatchdog : DriveMode::kEmergencyStop;
    for (; ms < 60; ++ms) {
      ASSERT_EQ(torque_of(drive), 0) << ms;
      ASSERT_EQ(host.torque(ms == 50 ? 0 : 1, ms * kMs),
                LinkRefusal::kNone);  // 0: no acknowledgement
      drive.tick(ms * kMs, 4, state);
      ASSERT_EQ(drive.mode(), reported) << "not reported until acknowledged";
    }
    EXPECT_GE(drive.report().stale_commands, 20U);
    EXPECT_EQ(host.state_in(state).mode, reported);
    ASSERT_EQ(host.torque(0.75, ms * kMs), LinkRefusal::kNone);  // the host ramps down
    drive.tick(ms * kMs, 4, state);
    EXPECT_EQ(torque_of(drive), 0);
    ASSERT_EQ(host.torque(0, ms * kMs), LinkRefusal::kNone);
    ASSERT_EQ(host.torque(1, ms * kMs), LinkRefusal::kNone);
    drive.tick(ms * kMs, 4, state);
    EXPECT_EQ(torque_of(drive), 1);
    EXPECT_EQ(host.state_in(state).mode, DriveMode::kTorque);
  }
}

TEST_F(DriveLink, WatchdogAllowsASlowHostTwoAndAHalfPeriods) {
  Drive drive(options(LinkClock::kReal), slowly_lowered_device());
  Host host(drive, key_);
  Drive::Answer state;
  ASSERT_TRUE(host.handshake(0, true, 1e-2));
  ASSERT_EQ(host.torque(1, 0), LinkRefusal::kNone);
  drive.tick(24 * kMs, 1, state);
  EXPECT_EQ(torque_of(drive), 1);
  drive.tick(26 * kMs, 1, state);
  EXPECT_EQ(torque_of(drive), 0);
}

TEST_F(DriveLink, ASecondHostCannotTakeOverAnActiveSession) {
  Drive drive(options(LinkClock::kReal), slowly_lowered_device());
  Host host(drive, key_), other(drive, key_);
  Drive::Answer state;
  ASSERT_TRUE(host.handshake(0));
  ASSERT_TRUE(other.handshake(0)) << "no offer before a session has begun";
  ASSERT_EQ(host.torque(1, 0), LinkRefusal::kNone);
  EXPECT_EQ(other.torque(2, 1 * kMs), LinkRefusal::kSession);
  EXPECT_FALSE(other.handshake(2 * kMs));
  EXPECT_EQ(other.denial(), DenialReason::kBusy);
  drive.tick(3 * kMs, 1, state);
  EXPECT_EQ(torque_of(drive), 1);
  // The first host sends nothing more: the second one gets a session, and the first one is refused.
  ASSERT_TRUE(other.handshake(20 * kMs, false));
  ASSERT_EQ(other.torque(2, 20 * kMs), LinkRefusal::kNone);
  EXPECT_EQ(host.torque(1, 21 * kMs), LinkRefusal::kSession);
  drive.tick(21 * kMs, 1, state);
  EXPECT_EQ(torque_of(drive), 2);
  EXPECT_EQ(drive.report().sessions, 2U);
}

// No amplifier: rare, smaller than what caused it, and for hellos only.
TEST_F(DriveLink, AHelloOfAnotherKeyIsDeniedAtMostTenTimesASecond) {
  Drive drive(options(LinkClock::kReal), slowly_lowered_device());
  Host stranger(drive, random_link_key());
  int denials = 0;
  for (int ms = 0; ms < 1000; ++ms) {
    EXPECT_FALSE(stranger.handshake(ms * kMs));
    if (!stranger.was_answered()) continue;
    ++denials;
    EXPECT_EQ(stranger.denial(), DenialReason::kKey);
    EXPECT_LT(stranger.answer().size(), stranger.hello().size());
  }
  EXPECT_EQ(denials, 10);
  // Two hosts that repeat their hellos in step are both answered.
  std::array<int, 2> answered{};
  std::array<Host, 2> hosts{Host(drive, random_link_key()), Host(drive, random_link_key())};
  for (Host& host : hosts)
    host.handshake(1900 * kMs);
  for (int ms = 2000; ms < 4000; ms += 50) {
    for (std::size_t i = 0; i < hosts.size(); ++i) {
      hosts[i].send(hosts[i].hello(), ms * kMs);
      if (hosts[i].was_answered()) ++answered[i];
    }
  }
  EXPECT_GE(answered[0], 2);
  EXPECT_GE(answered[1], 2);
  Bytes cut = stranger.hello();
  cut.pop_back();
  stranger.send(cut, 5000 * kMs);
  EXPECT_FALSE(stranger.was_answered());
  Bytes other_version = stranger.hello();
  other_version[4] = 2;
  stranger.send(other_version, 5000 * kMs);
  EXPECT_FALSE(stranger.was_answered());
  EXPECT_EQ(drive.report().sessions, 0U);
  Host host(drive, key_);
  EXPECT_TRUE(host.handshake(5000 * kMs)) << "the true host is welcome at once";
}

// A busy drive answers all queued hellos at once, and the host takes the first answer.
TEST_F(DriveLink, RepeatedHellosGetTheSameOffer) {
  Drive drive(options(LinkClock::kReal), slowly_lowered_device());
  Host host(drive, key_), other(drive, key_);
  ASSERT_TRUE(host.handshake(0));
  for (int i = 1; i < 10; ++i)
    ASSERT_EQ(host.send(host.hello(), i * kMs), LinkRefusal::kNone);
  ASSERT_TRUE(other.handshake(10 * kMs));
  EXPECT_EQ(host.torque(1, 11 * kMs), LinkRefusal::kNone);
  EXPECT_TRUE(drive.in_session());
  EXPECT_EQ(other.torque(1, 12 * kMs), LinkRefusal::kSession);
}

TEST_F(DriveLink, AReplayedSessionIsRefused) {
  Drive drive(options(LinkClock::kReal), slowly_lowered_device());
  Host host(drive, key_);
  Drive::Answer state;
  std::vector<Bytes> packets;
  ASSERT_TRUE(host.handshake(0));
  packets.push_back(host.hello());
  for (int i = 0; i < 20; ++i) {
    ASSERT_EQ(host.torque(1, i * kMs), LinkRefusal::kNone);
    packets.push_back(host.sent());
    drive.tick(i * kMs, 4, state);
  }
  ASSERT_EQ(host.command(CommandMode::kStop, 0, 20 * kMs), LinkRefusal::kNone);
  EXPECT_FALSE(drive.in_session());
  // All packets again, in order and with the same timing: the hello is answered, no command
  // accepted.
  for (std::size_t i = 0; i < packets.size(); ++i) {
    const std::int64_t now = (30 + static_cast<std::int64_t>(i)) * kMs;
    EXPECT_EQ(host.send(packets[i], now), i == 0 ? LinkRefusal::kNone : LinkRefusal::kSession);
    drive.tick(now, 4, state);
    EXPECT_EQ(torque_of(drive), 0);
    EXPECT_EQ(state.size, 0U);
  }
  // Replayed hellos do not disturb the handshake of the true host.
  ASSERT_TRUE(host.handshake(100 * kMs));
  for (int i = 0; i < 3; ++i)
    EXPECT_EQ(host.send(packets[0], 100 * kMs), LinkRefusal::kNone);
  EXPECT_EQ(host.torque(1, 101 * kMs), LinkRefusal::kNone);
}

TEST_F(DriveLink, OnlyAFreshSessionRestartsTheWorld) {
  Drive drive(options(LinkClock::kLockStep), slowly_lowered_device());
  Host host(drive, key_);
  ASSERT_TRUE(host.handshake(0));
  for (int i = 0; i < 30; ++i)
    ASSERT_EQ(host.torque(0, 0), LinkRefusal::kNone);
  ASSERT_EQ(host.command(CommandMode::kStop, 0, 0), LinkRefusal::kNone);
  ASSERT_TRUE(host.handshake(0, false));
  ASSERT_EQ(host.command(CommandMode::kFree, 0, 0), LinkRefusal::kNone);
  EXPECT_NEAR(drive.session_time_s(), 0.03, 1e-12);
  ASSERT_EQ(host.command(CommandMode::kStop, 0, 0), LinkRefusal::kNone);
  ASSERT_TRUE(host.handshake(0, true));
  ASSERT_EQ(host.command(CommandMode::kFree, 0, 0), LinkRefusal::kNone);
  EXPECT_EQ(drive.session_time_s(), 0);
}

TEST_F(DriveLink, InvalidPacketsChangeNothingUnderLoad) {
  const long packets = test::campaign(200'000);
  Drive drive(options(LinkClock::kReal), slowly_lowered_device());
  Host host(drive, key_);
  Drive::Answer state;
  ASSERT_TRUE(host.handshake(0));
  ASSERT_EQ(host.torque(1, 0), LinkRefusal::kNone);
  const Bytes seeds[] = {host.hello(), host.sent()};
  int denials = 0;
  std::mt19937_64 random(4);
  for (long n = 0; n < packets; ++n) {
    Bytes bytes = seeds[n % 2];
    if (n % 5 == 0) {
      bytes.resize(random() % 260);
      for (std::uint8_t& b : bytes)
        b = static_cast<std::uint8_t>(random());
    } else {
      for (std::uint64_t changes = 1 + random() % 3; changes > 0; --changes)
        bytes[random() % bytes.size()] ^= static_cast<std::uint8_t>(1 + random() % 255);
      if (bytes == seeds[n % 2]) continue;
    }
    ASSERT_NE(host.send(bytes, 5 * kMs), LinkRefusal::kNone) << n;
    if (host.was_answered()) ++denials;
    ASSERT_FALSE(host.from_host());
  }
  EXPECT_LE(denials, 1) << "at one moment";
  drive.tick(9 * kMs, 1, state);
  EXPECT_EQ(torque_of(drive), 1);
  EXPECT_EQ(host.state_in(state).command_taken, 1U);
  drive.tick(11 * kMs, 1, state);
  EXPECT_EQ(torque_of(drive), 0) << "invalid packets reset the watchdog";
  EXPECT_EQ(drive.report().packets.accepted(), 2U);
}

// --- faults --------------------------------------------------------------------------------

TEST_F(DriveLink, EmergencyStopKeepsTorquesAtZeroUntilAcknowledged) {
  Drive drive(options(LinkClock::kLockStep, "stop@0.01..0.02"), slowly_lowered_device());
  Host host(drive, key_);
  ASSERT_TRUE(host.handshake(0));
  for (int tick = 0; tick < 30; ++tick) {
    ASSERT_EQ(host.torque(1, 0), LinkRefusal::kNone);
    // Pressed in the period that begins at 10 ms, it is in the state at the end of that period.
    // After its release it is reported until the host acknowledges it.
    const bool stopped = tick >= 10 && tick <= 25;
    EXPECT_EQ(torque_of(drive), stopped ? 0 : 1) << tick;
    EXPECT_EQ(host.state().mode, stopped ? DriveMode::kEmergencyStop : DriveMode::kTorque);
    if (tick == 15) {
      ASSERT_EQ(host.command(CommandMode::kFree, 0, 0), LinkRefusal::kNone);
      EXPECT_EQ(host.state().mode, DriveMode::kEmergencyStop) << "acknowledged while pressed";
    }
    if (tick == 25) {
      ASSERT_EQ(host.command(CommandMode::kFree, 0, 0), LinkRefusal::kNone);
      EXPECT_EQ(host.state().mode, DriveMode::kReady);
    }
  }
  EXPECT_EQ(drive.report().emergency_stops, 1U);
}

// Contract 5: the host was lost while the stop was pressed and released.
TEST_F(DriveLink, ALaterSessionReportsAStopThatNoHostHasAcknowledged) {
  for (const bool resets_world : {false, true}) {
    Drive drive(options(LinkClock::kReal, "stop@0.05..0.06"), slowly_lowered_device());
    Host host(drive, key_);
    ASSERT_TRUE(host.handshake(0));
    ASSERT_EQ(host.torque(1, 0), LinkRefusal::kNone);
    Drive::Answer state;
    for (std::int64_t ms = 1; ms <= 2000; ++ms)
      drive.tick(ms * kMs, 4, state);
    ASSERT_FALSE(drive.in_session());
    ASSERT_TRUE(host.handshake(2000 * kMs, resets_world));
    ASSERT_EQ(host.command(CommandMode::kFree, 0, 2000 * kMs), LinkRefusal::kNone);
    for (std::int64_t ms = 2001; ms <= 2003; ++ms) {
      drive.tick(ms * kMs, 4, state);
      EXPECT_EQ(host.state_in(state).mode,
                resets_world ? DriveMode::kReady : DriveMode::kEmergencyStop);
    }
    ASSERT_EQ(host.command(CommandMode::kFree, 0, 2003 * kMs), LinkRefusal::kNone);
    drive.tick(2004 * kMs, 4, state);
    EXPECT_EQ(host.state_in(state).mode, DriveMode::kReady) << "acknowledged";
  }
}

TEST(FaultPlan, ParsesValidItemsAndRefusesInvalidOnes) {
  const auto plan = parse_fault_plan(
      "loss:0.01,state-loss:1@2.5..2.6,command-delay:0.5:7,jump:15:-0.2@3,stuck:0@1,dead:7@1..2,"
      "stop@4,kill@5,flip:1e-3,duplicate:1,reorder:0.1");
  ASSERT_TRUE(plan) << plan.error().message;
  ASSERT_EQ(plan->size(), 11U);
  const PlannedFault& timed = (*plan)[1];
  EXPECT_FALSE(timed.on_commands);
  EXPECT_TRUE(timed.on_states);
  EXPECT_FALSE(timed.is_on(2.4));
  EXPECT_TRUE(timed.is_on(2.5));
  EXPECT_FALSE(timed.is_on(2.6));
  EXPECT_EQ((*plan)[2].delay_s, 7e-3);
  EXPECT_EQ((*plan)[2].probability, 0.5);
  EXPECT_EQ((*plan)[3].channel, 15);
  EXPECT_EQ((*plan)[3].jump_rad, -0.2);
  EXPECT_TRUE((*plan)[3].is_on(1e5));
  EXPECT_TRUE(parse_fault_plan("")->empty());
  for (const char* bad :
       {"losss:1",    "loss",     "loss:2",     "loss:-1",         "loss:nan",
        "loss:1:2",   "loss:1@",  "loss:1@x",   "loss:1@2..1",     "loss:1@1...2",
        "stuck:16",   "stuck:-1", "stuck:1.5",  "dead:8",          "jump:1",
        "jump:1:inf", "stop:1",   "state-stop", "command-stuck:1", "stop,",
        ",stop",      ",",        "kill@-1",    "delay:0.5",       "loss:1@1..2..3",
        "loss:0x1",   "loss: 1"}) {
    const auto refused = parse_fault_plan(bad);
    EXPECT_FALSE(refused) << bad;
    if (!refused) {
      EXPECT_EQ(refused.error().code, ExitCode::kUsage);
    }
  }
}

/// Sends numbered datagrams through a link with these faults, one per millisecond.
struct Delivered {
  std::vector<int> number;
  std::vector<int> at_ms;
  int changed = 0;
};
Delivered through(const char* faults, LinkDirection way) {
  constexpr int kCount = 4000;
  const auto plan = parse_fault_plan(faults);
  EXPECT_TRUE(plan);
  FaultyLink link(*plan, way, 1);
  Delivered out;
  for (int ms = 0; ms < kCount + 100; ++ms) {
    const auto deliver = [&](const FaultyLink::Datagram& d) {
      const int number = d.bytes[0] + 256 * d.bytes[1];
      if (d.bytes[2] != 7 || d.bytes[3] != 7 || number >= kCount) {
        ++out.changed;
        return;
      }
      out.number.push_back(number);
      out.at_ms.push_back(ms);
    };
    link.release_due(ms * kMs, deliver);
    if (ms >= kCount) continue;
    FaultyLink::Datagram datagram;
    datagram.size = 4;
    datagram.bytes = {static_cast<std::uint8_t>(ms % 256), static_cast<std::uint8_t>(ms / 256), 7,
                      7};
    link.pass(datagram, ms * 1e-3, ms * kMs, deliver);
  }
  EXPECT_FALSE(link.holds_any());
  return out;
}

TEST(FaultyLink, EachKindOfFaultHasItsEffect) {
  const std::size_t all = 4000;
  EXPECT_EQ(through("", LinkDirection::kStates).number.size(), all);
  EXPECT_EQ(through("command-loss:1", LinkDirection::kStates).number.size(), all);
  EXPECT_EQ(through("command-loss:1", LinkDirection::kCommands).number.size(), 0U);
  EXPECT_EQ(through("loss:1@1..2", LinkDirection::kStates).number.size(), all - 1000);
  EXPECT_NEAR(static_cast<double>(through("loss:0.25", LinkDirection::kStates).number.size()), 3000,
              120);
  EXPECT_NEAR(static_cast<double>(through("duplicate:0.25", LinkDirection::kStates).number.size()),
              5000, 120);
  EXPECT_GT(through("flip:0.25", LinkDirection::kStates).changed, 300);
  const Delivered late = through("delay:0.3:5", LinkDirection::kStates);
  EXPECT_EQ(late.number.size(), all);
  int delayed = 0;
  for (std::size_t i = 0; i < late.number.size(); ++i) {
    const int by = late.at_ms[i] - late.number[i];
    EXPECT_TRUE(by == 0 || by == 5) << by;
    delayed += by == 5 ? 1 : 0;
  }
  EXPECT_NEAR(delayed, 1200, 120);
  const Delivered mixed = through("reorder:0.1", LinkDirection::kStates);
  EXPECT_EQ(mixed.number.size(), all);
  int overtaken = 0;
  for (std::size_t i = 1; i < mixed.number.size(); ++i)
    overtaken += mixed.number[i] < mixed.number[i - 1] ? 1 : 0;
  EXPECT_NEAR(overtaken, 380, 80);
}

}  // namespace
}  // namespace trocar::runtime
