// SPDX-License-Identifier: GPL-3.0-or-later
// A stream of packets to a drive: hosts send hellos and commands, an attacker between them repeats,
// delays, reorders, changes and forges packets. In: operations of a few bytes each, see run(). For
// every stream: changed and forged packets are refused, and so are repeated ones and ones older
// than the last accepted; torques follow the newest command, and are zero after a time without
// packets until a command of zero torques acknowledges this; packets of the drive are authentic, in
// order, and of its session.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <optional>
#include <vector>

#include "formats/session/device_protocol.h"
#include "runtime/device/simulated/drive.h"
#include "tests/fuzz/harness.h"
#include "tests/support/link_corpus.h"

namespace {

using namespace trocar;           // NOLINT(google-build-using-namespace): a program of one file
using namespace trocar::runtime;  // NOLINT(google-build-using-namespace)
using fuzz::fail;
using link_corpus::shared_key;
using Datagram = std::vector<std::uint8_t>;

constexpr int kMaxOperations = 200, kMaxPeriods = 100;
constexpr double kPeriod_s = 1e-3;  // the host's

const SimulatedDevice& model() {
  static const SimulatedDevice made = [] {
    if (!start_link()) std::abort();
    DeviceDescription description = default_device_description();
    description.minimum_substeps = 1;  // the dynamics are not under test
    HandTrajectory hand;
    hand.keyframes.resize(1);
    hand.keyframes[0].T_device_tool.p_m.z() = 0.15;
    return *SimulatedDevice::make(description, hand, {});
  }();
  return made;
}

/// The host's side of a session.
struct Session {
  LinkKey key;
  std::uint64_t number = 0, sequence = 0, last_state = 0;
  bool over = false;
};

class Stream {
 public:
  explicit Stream(LinkClock clock)
      : drive_({shared_key(), clock, kPeriod_s, 0.01, 1, {}}, model()), clock_(clock) {}

  void run(fuzz::Bytes bytes) {
    for (int n = 0; n < kMaxOperations && !bytes.empty(); ++n) {
      switch (bytes.below(8)) {
        case 0:
          hello(bytes);
          break;
        case 1:
        case 2:
          command(bytes);
          break;
        case 3:
          repeat(bytes);
          break;
        case 4:
          change(bytes);
          break;
        case 5:
          forge(bytes);
          break;
        case 6:
          wait(1 + bytes.below(4));
          break;
        default:
          now_ns_ += std::int64_t{bytes.below(16)} * 100'000'000;  // a delay of the network
      }
    }
  }

 private:
  // A refused packet is answered only if it is a hello, by a denial that names its nonce, and at
  // most ten times a second.
  void check_denial(const Datagram& datagram, const Drive::Answer& answer) {
    LinkNonce nonce{};
    DenialPacket denial;
    if (!hello_nonce(datagram, nonce)) fail("a refused packet that is no hello is answered");
    if (decode(answer.view(), nonce, denial) != LinkRefusal::kNone)
      fail("a refused hello is answered by something else than its denial");
    if (denied_ns_ && now_ns_ - *denied_ns_ < 100'000'000) fail("denials follow one another");
    denied_ns_ = now_ns_;
  }

  // Gives a packet to the drive; `genuine`: made by a host. Stores the answer of an accepted
  // packet.
  LinkRefusal give(const Datagram& datagram, bool genuine) {
    Drive::Answer answer;
    bool from_host = false;
    const std::uint64_t sessions = drive_.report().sessions;
    const double time_s = drive_.session_time_s();
    const DriveMode mode = drive_.mode();
    const LinkRefusal refusal = drive_.receive(datagram, now_ns_, answer, from_host);
    if (refusal != LinkRefusal::kNone) {
      if (from_host) fail("a refused packet is a host's");
      if (answer.size > 0) check_denial(datagram, answer);
      if (sessions != drive_.report().sessions || time_s != drive_.session_time_s() ||
          mode != drive_.mode())
        fail("a refused packet changes something");
      return refusal;
    }
    if (!genuine) fail("a packet is accepted that no host made");
    answer_ = answer;
    return refusal;
  }

  void hello(fuzz::Bytes& bytes) {
    HelloPacket packet;
    packet.time_ns = now_ns_;
    packet.host_nonce = {bytes.next(), bytes.next(), 1};
    packet.period_s = kPeriod_s;
    packet.resets_world = bytes.below(2) == 0;
    Datagram datagram(kMaxPacketBytes);
    datagram.resize(encode(packet, shared_key(), datagram));
    sent_.push_back(datagram);
    if (give(datagram, true) != LinkRefusal::kNone) return;
    WelcomePacket welcome;
    if (decode(answer_.view(), shared_key(), packet.host_nonce, welcome) != LinkRefusal::kNone)
      fail("a hello is accepted without a welcome");
    const std::uint64_t number = session_number(welcome.drive_nonce);
    const bool known = std::any_of(sessions_.begin(), sessions_.end(),
                                   [&](const Session& s) { return s.number == number; });
    if (known) return;  // a repeated hello
    sessions_.push_back(
        {session_key(shared_key(), packet.host_nonce, welcome.drive_nonce), number, 0, 0, false});
  }

  void command(fuzz::Bytes& bytes) {
    if (sessions_.empty()) return;
    const std::size_t which =
        sessions_.size() - 1 - static_cast<std::size_t>(bytes.below(4)) % sessions_.size();
    Session& session = sessions_[which];
    const int how = bytes.below(16);
    CommandPacket packet;
    packet.session = session.number;
    packet.sequence = session.sequence + static_cast<std::uint64_t>(how % 4 == 3 ? how : 1);
    packet.time_ns = now_ns_;
    packet.mode = how == 15   ? CommandMode::kStop
                  : how == 14 ? CommandMode::kFree
                              : CommandMode::kTorque;
    if (how % 2 == 0) packet.state_seen = session.last_state;
    if (packet.mode == CommandMode::kTorque) packet.tau_motor_Nm.fill(0.01 * bytes.small());
    Datagram datagram(kMaxPacketBytes);
    datagram.resize(encode(packet, session.key, datagram));
    if (datagram.empty()) fail("a command is not encoded");
    session.sequence = packet.sequence;
    sent_.push_back(datagram);
    if (how % 8 == 5) return;  // delayed: see repeat()
    if (give(datagram, true) == LinkRefusal::kNone) accepted_now(packet, which);
  }

  // The drive has accepted this command.
  void accepted_now(const CommandPacket& packet, std::size_t which) {
    if (sessions_[which].over) fail("an ended session begins again");
    if (in_session_ && which == current_ && packet.sequence <= accepted_)
      fail("a command is accepted twice, or after a newer one");
    if (!in_session_ || which != current_) watchdog_state_ = 0;
    const bool asks_for_zero = std::all_of(packet.tau_motor_Nm.begin(), packet.tau_motor_Nm.end(),
                                           [](double tau) { return tau == 0; });
    if (packet.state_seen >= watchdog_state_ && asks_for_zero) watchdog_state_ = 0;
    if (in_session_ && which != current_) {
      const std::int64_t longest_ns = clock_ == LinkClock::kReal ? 10'000'000 : 1'000'000'000;
      if (now_ns_ - newest_ns_ <= longest_ns) fail("a session begins while another is active");
      sessions_[current_].over = true;
    }
    accepted_ = packet.sequence;
    current_ = which;
    in_session_ = packet.mode != CommandMode::kStop;
    sessions_[which].over = !in_session_;
    if (drive_.in_session() != in_session_) fail("the drive and the hosts disagree on the session");
    newest_ = packet;
    newest_ns_ = now_ns_;
    if (clock_ == LinkClock::kLockStep && in_session_) expect_state(answer_);
    expect_torques();
  }

  // A packet that was sent before, or a delayed one.
  void repeat(fuzz::Bytes& bytes) {
    if (sent_.empty()) return;
    const Datagram datagram = sent_[static_cast<std::size_t>(bytes.next()) % sent_.size()];
    if (give(datagram, true) != LinkRefusal::kNone) return;
    if (claimed_kind(datagram) == PacketKind::kHello) return;  // no host waits for the welcome
    for (std::size_t i = 0; i < sessions_.size(); ++i) {
      CommandPacket packet;
      std::uint64_t last = 0;
      const Session& session = sessions_[i];
      if (decode(datagram, session.key, session.number, last, packet) == LinkRefusal::kNone)
        return accepted_now(packet, i);
    }
    fail("a command is accepted that belongs to no session");
  }

  void change(fuzz::Bytes& bytes) {
    if (sent_.empty()) return;
    Datagram changed = sent_[static_cast<std::size_t>(bytes.next()) % sent_.size()];
    const Datagram original = changed;
    const std::size_t at = static_cast<std::size_t>(bytes.next()) % changed.size();
    switch (bytes.below(3)) {
      case 0:
        changed[at] ^= static_cast<std::uint8_t>(1 + bytes.below(255));
        break;
      case 1:
        changed.resize(at);
        break;
      default:
        changed.push_back(bytes.next());
    }
    if (changed == original) return;
    give(changed, false);
  }

  void forge(fuzz::Bytes& bytes) {
    Datagram made(static_cast<std::size_t>(bytes.next()));
    for (std::uint8_t& byte : made)
      byte = bytes.next();
    give(made, false);
  }

  void wait(int periods) {
    periods = std::min(periods, kMaxPeriods - waited_);
    waited_ += periods;
    for (int i = 0; i < periods && clock_ == LinkClock::kReal; ++i) {
      now_ns_ += static_cast<std::int64_t>(kPeriod_s * 1e9);
      Drive::Answer answer;
      drive_.tick(now_ns_, 1, answer);
      if (in_session_ && !drive_.in_session()) {
        in_session_ = false;
        sessions_[current_].over = true;
      }
      if (drive_.in_session() && answer.size == 0) fail("no state for the host");
      if (answer.size > 0) expect_state(answer);
      expect_torques();
    }
  }

  void expect_state(const Drive::Answer& answer) {
    Session& session = sessions_[current_];
    StatePacket state;
    if (decode(answer.view(), session.key, session.number, session.last_state, state) !=
        LinkRefusal::kNone)
      fail("the host refuses a state of its drive");
    if (state.mode == DriveMode::kWatchdog && watchdog_state_ == 0) {
      if (now_ns_ - newest_ns_ <= 10'000'000) fail("the watchdog tripped too early");
      watchdog_state_ = state.sequence;
    }
    if (state.command_taken != accepted_)
      fail("the drive reports another command than the accepted one");
    for (const double angle : state.encoder_rad) {
      if (!std::isfinite(angle)) fail("an angle that is not finite");
    }
  }

  // Contract 1 of drive.h. The drive must know the current time.
  void expect_torques() const {
    const auto& applied = drive_.model().truth().tau_motor_Nm;
    const bool silent = clock_ == LinkClock::kReal && now_ns_ - newest_ns_ > 10'000'000;
    const bool wanted =
        in_session_ && !silent && watchdog_state_ == 0 && newest_.mode == CommandMode::kTorque;
    if ((drive_.mode() == DriveMode::kTorque) != wanted)
      fail("torques without a command, or a command without torques");
    // Torques reach the motors with the next time step.
    if (waited_ == 0 || (clock_ == LinkClock::kReal && now_ns_ == newest_ns_)) return;
    for (std::size_t i = 0; i < kMotors && clock_ == LinkClock::kReal; ++i) {
      if (applied[static_cast<int>(i)] != (wanted ? newest_.tau_motor_Nm[i] : 0))
        fail("a torque other than the commanded one");
    }
  }

  Drive drive_;
  Drive::Answer answer_;
  std::vector<Session> sessions_;
  std::vector<Datagram> sent_;
  std::size_t current_ = 0;
  std::uint64_t accepted_ = 0;
  CommandPacket newest_;
  /// Sequence of the first state after a watchdog that no command has acknowledged; 0: none.
  std::uint64_t watchdog_state_ = 0;
  std::optional<std::int64_t> denied_ns_;
  std::int64_t now_ns_ = 0, newest_ns_ = 0;
  int waited_ = 0;
  LinkClock clock_;
  bool in_session_ = false;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  model();
  Stream stream(data[0] % 2 == 0 ? LinkClock::kReal : LinkClock::kLockStep);
  stream.run({data + 1, size - 1});
  return 0;
}
