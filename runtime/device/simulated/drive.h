// SPDX-License-Identifier: Apache-2.0
// A simulated drive behind the device link, the faults to inject into it, and its steps as CSV.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <random>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/device_protocol.h"
#include "runtime/device/link/udp_link.h"
#include "runtime/device/simulated/simulated_device.h"

namespace trocar::runtime {

// Faults to inject into a simulated drive and its link, each with kind, time and probability.
// Random choices are seeded, so the same plan, seed and packets give the same faults.
//
// A plan is a text of items separated by commas. Each item has the form
// KIND[:VALUE[:VALUE]][@FROM[..TO]]. The fault begins at FROM (default: 0) and ends at TO (default:
// never). Times are simulated times in s. They begin at 0 in each session that resets the simulated
// world, but continue if a lost link is restored.
//   loss:P             packets are lost
//   delay:P:MS         packets are delayed by MS ms
//   duplicate:P        packets are delivered twice
//   reorder:P          packets are delivered after the next packet, at the latest after 20 ms
//   flip:P             one bit of a packet is inverted
//   stuck:ENCODER      an encoder, 0 to 15, keeps its angle
//   jump:ENCODER:RAD   RAD is added to the angle of an encoder, 0 to 15, in rad
//   dead:MOTOR         a motor, 0 to 7, applies no torque
//   stop               the emergency stop is pressed
//   kill               the process that simulates the drive is killed
// P is the probability with which the fault concerns a packet. Faults of packets concern both
// commands and states. If "command-" or "state-" stands before the kind, the fault concerns only
// commands or only states.
// Example: loss:0.01,state-loss:1@2.5..2.6,jump:4:0.2@3,stop@4

enum class FaultKind : std::uint8_t {
  kLoss,
  kDelay,
  kDuplicate,
  kReorder,
  kFlip,
  kStuck,
  kJump,
  kDead,
  kStop,
  kKill,
};
enum class LinkDirection : std::uint8_t { kCommands, kStates };

struct PlannedFault {
  FaultKind kind = FaultKind::kLoss;
  bool on_commands = true, on_states = true;  ///< directions of a packet fault
  double probability = 1;                     ///< probability of a packet fault
  double delay_s = 0;
  int channel = 0;  ///< encoder or motor
  double jump_rad = 0;
  double from_s = 0, to_s = std::numeric_limits<double>::infinity();  ///< active in [from_s, to_s)
  bool is_on(double t_s) const noexcept { return t_s >= from_s && t_s < to_s; }
};
using FaultPlan = std::vector<PlannedFault>;

/// Parses a plan. An empty text gives an empty plan. Errors: kUsage; the message quotes the item
/// that is wrong.
Result<FaultPlan> parse_fault_plan(std::string_view text);

/// One direction of a link with faults. The link holds back at most kHeld packets that are delayed
/// or reordered; further such packets are lost.
class FaultyLink {
 public:
  static constexpr std::size_t kHeld = 64;
  struct Datagram {
    std::array<std::uint8_t, 512> bytes{};
    std::size_t size = 0;  ///< size of the datagram, at most bytes.size()
    Endpoint peer;
    std::span<const std::uint8_t> view() const noexcept { return {bytes.data(), size}; }
  };

  FaultyLink(const FaultPlan& plan, LinkDirection way, std::uint64_t seed);

  /// Sends `datagram` over the link. Calls `deliver` with each datagram that arrives now.
  /// Because of faults, `datagram` may arrive once, several times, changed, later or never.
  /// `t_s`: the simulated time; `now_ns`: the time of a monotonic clock.
  template <typename Deliver>
  void pass(const Datagram& datagram, double t_s, std::int64_t now_ns, Deliver&& deliver) {
    Datagram changed = datagram;
    const int copies = decide(changed, t_s, now_ns);
    for (int i = 0; i < copies; ++i)
      deliver(changed);
    // This datagram has overtaken the datagrams that wait to be overtaken.
    if (copies > 0) release(now_ns, true, deliver);
  }
  /// Calls `deliver` with each delayed or reordered datagram that is due.
  template <typename Deliver>
  void release_due(std::int64_t now_ns, Deliver&& deliver) {
    release(now_ns, false, deliver);
  }
  bool holds_any() const noexcept { return held_count_ > 0; }

 private:
  struct Held {
    Datagram datagram;
    std::int64_t due_ns = 0;
    bool until_overtaken = false;  ///< delivered before `due_ns` if another datagram arrives
  };
  // Returns the number of copies that are delivered immediately.
  int decide(Datagram& datagram, double t_s, std::int64_t now_ns) noexcept;
  bool happens(double probability) noexcept;
  void hold(const Datagram& datagram, std::int64_t due_ns, bool until_overtaken) noexcept;

  template <typename Deliver>
  void release(std::int64_t now_ns, bool overtaken, Deliver&& deliver) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < held_count_; ++i) {
      if (held_[i].due_ns <= now_ns || (overtaken && held_[i].until_overtaken))
        deliver(held_[i].datagram);
      else if (kept++ != i)
        held_[kept - 1] = held_[i];
    }
    held_count_ = kept;
  }

  FaultPlan plan_;
  std::mt19937_64 random_;
  std::vector<Held> held_;  ///< the size is always kHeld
  std::size_t held_count_ = 0;
};

// The drive's side of the device link, with a simulated device behind it. The host's side is
// udp_link.h. The drive holds a link session with one host, sets the torques to zero if commands
// stay away (watchdog), checks whether motors follow their commands, and can inject faults. It uses
// no socket: the caller passes received datagrams to the drive, and sends the datagrams that the
// drive returns.
//
// Contract:
//  1. Torques are nonzero only while three conditions hold: the newest accepted command has the
//     mode torque; with the real clock, this command is not older than the watchdog's time; and no
//     emergency stop is pressed. After the watchdog or the stop has set the torques to zero,
//     torques stay zero until the host acknowledges the zero torques. The acknowledgement is a
//     command of zero torques that the host sends after it has received a state that reports zero
//     torques. All commands before the acknowledgement have no effect, for example the nonzero
//     torques of a host that ramps down.
//  2. A refused datagram only changes a count. There is one exception: a hello, which requests a
//     session, is answered with a denial if it has another key, asks for a drive that reports poses
//     instead of encoder angles, or arrives while a session is alive. At most one denial is sent in
//     kDenialPeriod_s. A repeated hello (one with the random number, the nonce, of the last denied
//     hello) is denied at most once in kRepeatedDenial_s.
//  3. While a session is alive, no other session begins. With the real clock, a session is alive as
//     long as its last command is not older than the watchdog's time. In lock-step (item 4), a
//     session is alive as long as its last command is not older than session_s. A session that is
//     not alive can continue with a later command, unless another session has begun, or (real
//     clock) session_s have passed.
//  4. In lock-step, time does not follow a real clock. Each command of the mode torque advances
//     time by one period of the host, and nothing else advances time.
//  5. The host learns of every stop of the same world, also of one that was pressed and released
//     between two sessions: the next session reports it until the host has acknowledged it.

struct DriveOptions {
  LinkKey key;
  LinkClock clock = LinkClock::kReal;
  double period_s = 2.5e-4;  ///< period of the drive's own clock
  /// Real clock only: time without a command after which torques are set to zero. If 2.5 periods of
  /// the host are longer than this, the watchdog's time is 2.5 periods.
  double watchdog_s = 0.01;
  /// Real clock: after this time without a command the session is over, and its host receives no
  /// more states. Lock-step: after this time without a command another host may begin a session.
  double session_s = 1;
  FaultPlan faults;
  std::size_t record_steps = 0;  ///< capacity of DriveReport::steps
};

/// One simulation step of the drive.
struct DriveStep {
  std::uint64_t session = 0;  ///< number of the session, counted from 1
  double t_s = 0;             ///< simulated time at the end of the step
  DriveMode mode = DriveMode::kReady;
  /// Bit i: at some time in this session motor i did not follow its command.
  std::uint8_t motor_faults = 0;
  bool fault = false;                 ///< an injected fault was active at the start of the step
  std::uint64_t command_taken = 0;    ///< sequence number of the newest accepted command
  double commanded_max_Nm = 0;        ///< largest commanded torque of a motor
  double applied_max_Nm = 0;          ///< largest applied torque of a motor
  std::uint64_t packets_refused = 0;  ///< packets refused so far
  TrueTip tip{};                      ///< tip at the end of the step
};

/// A maximum of the force on the hand. It is at least 10 N, and the force then fell to less than
/// half of the maximum.
struct ForcePeak {
  double t_s = 0;
  double force_N = 0;
};

/// Counts of the drive, and forces on the simulated hand.
struct DriveReport {
  std::uint64_t sessions = 0;
  LinkCounts packets;
  std::uint64_t commands_missed = 0;  ///< commands that were lost or overtaken by a newer one
  std::uint64_t watchdog_trips = 0;   ///< how often the watchdog set nonzero torques to zero
  /// Commands without effect, because zero torques were not acknowledged yet (contract 1).
  std::uint64_t stale_commands = 0;
  std::uint64_t emergency_stops = 0;
  double largest_torque_Nm = 0;     ///< largest applied torque of a motor
  double largest_hand_force_N = 0;  ///< largest force of the hand on the tool's tip
  std::vector<ForcePeak> peaks;     ///< the first kMaxPeaks peaks
  std::vector<DriveStep> steps;     ///< the first DriveOptions::record_steps steps
  static constexpr std::size_t kMaxPeaks = 4096;
};

class Drive {
 public:
  /// `model`: the simulated device in its initial state. A session that resets the simulated world
  /// starts with a copy of `model`.
  Drive(const DriveOptions& options, SimulatedDevice model);

  /// A datagram to send.
  struct Answer {
    std::array<std::uint8_t, kMaxPacketBytes> bytes{};
    std::size_t size = 0;  ///< 0 if there is no answer
    std::span<const std::uint8_t> view() const noexcept { return {bytes.data(), size}; }
  };

  /// Processes one datagram. The caller must send `answer` to the datagram's sender. Returns kNone
  /// if the datagram was accepted, and otherwise the reason for its refusal. `from_host` becomes
  /// true if the datagram was an accepted command, otherwise false. The caller must send the states
  /// of tick() to the sender of the last accepted command.
  LinkRefusal receive(std::span<const std::uint8_t> datagram, std::int64_t now_ns, Answer& answer,
                      bool& from_host) noexcept;

  /// Real clock only. If the process was delayed, call this before receive() gets the commands that
  /// arrived during the delay. Simulates `periods` missed periods up to `until_ns` with the present
  /// command, so that the watchdog and injected faults act at the right time.
  void catch_up(std::int64_t until_ns, int periods) noexcept;
  /// Real clock only. Advances time by `periods` periods of the drive, so that the last period ends
  /// now. `answer` is the state for the host, if there is a session.
  void tick(std::int64_t now_ns, int periods, Answer& answer) noexcept;

  /// True if there is a session, even if it is not alive (contract 3).
  bool in_session() const noexcept { return session_.has_value(); }
  double session_time_s() const noexcept { return model_.truth().t_s; }
  DriveMode mode() const noexcept { return mode_; }
  /// Returns true if the fault plan says that the drive's process is to be killed now (`kill`,
  /// above). The caller must then kill the process.
  bool kill_is_due() const noexcept { return session_ && is_injected(FaultKind::kKill); }
  const SimulatedDevice& model() const noexcept { return model_; }
  const DriveReport& report() const noexcept { return report_; }

 private:
  struct LinkSession {
    LinkKey key;
    LinkNonce host_nonce{}, drive_nonce{};
    std::uint64_t number = 0;
    double period_s = 0;        ///< period of the host
    double watchdog_s = 0;      ///< watchdog time for this period
    bool resets_world = false;  ///< the session resets the simulated world when it begins
    std::uint64_t last_command = 0, last_state = 0;  ///< sequence numbers
    /// Sequence number of the first state that reports zero torques (contract 1); 0: the host has
    /// nothing to acknowledge.
    std::uint64_t reported_from = 0;
    std::int64_t last_command_ns = 0;
  };
  bool is_alive(std::int64_t now_ns) const noexcept;
  void deny(std::span<const std::uint8_t> hello, DenialReason reason, std::int64_t now_ns,
            Answer& answer) noexcept;
  void offer(const HelloPacket& hello, std::int64_t now_ns, Answer& answer) noexcept;
  void begin(LinkSession offered) noexcept;
  void take(const CommandPacket& command, std::int64_t now_ns, Answer& answer) noexcept;
  void end_session() noexcept;
  void check_watchdog(std::int64_t now_ns) noexcept;
  void advance(double dt_s) noexcept;
  void check_emergency_stop() noexcept;
  void supervise(double dt_s) noexcept;
  void record_hand_force() noexcept;
  void send_state(Answer& answer) noexcept;
  void zero_torques(DriveMode mode) noexcept;
  bool is_injected(FaultKind kind) const noexcept;
  void record_step(bool fault) noexcept;

  static constexpr std::size_t kOffers = 4;
  static constexpr double kDenialPeriod_s = 0.1, kRepeatedDenial_s = 1;

  DriveOptions options_;
  SimulatedDevice fresh_, model_;
  std::optional<LinkSession> session_;
  std::array<std::optional<LinkSession>, kOffers> offers_;  ///< offered but not yet begun
  std::size_t next_offer_ = 0;
  std::optional<std::int64_t> denied_ns_;  ///< time of the last denial
  LinkNonce denied_nonce_{};               ///< nonce of the host that received the last denial
  DeviceCommand command_;
  std::array<double, kMotors> not_following_s_{};
  std::array<std::optional<double>, kEncoders> stuck_at_rad_;
  double peak_N_ = 0, peak_t_s_ = 0, valley_N_ = 0;
  DriveReport report_;
  DriveMode mode_ = DriveMode::kReady;
  std::uint8_t motor_faults_ = 0;
  bool stop_pressed_ = false;
  bool stop_is_unacknowledged_ = false;  ///< no host has acknowledged the stop yet (contract 5)
  /// The hand's force has fallen from a peak, and has not yet risen by 10 N from its lowest value.
  bool falling_ = false;
};

// Writes a drive's steps as CSV. The first line names every column with its unit. Each number has
// the fewest digits that give the same value when read again.

/// Columns: session,t_s,mode,motor_faults,fault,command_taken,commanded_max_Nm,applied_max_Nm,
/// packets_refused,tool_x_m,tool_y_m,tool_z_m,tool_x_m_per_s,tool_y_m_per_s,tool_z_m_per_s. The
/// mode is ready, torque, watchdog or emergency_stop. The last six columns are the exact position
/// and velocity of the tool's tip in {B}, as the simulation knows them. The other columns are the
/// members of DriveStep with the same names.
std::string to_csv(std::span<const DriveStep> steps);

}  // namespace trocar::runtime
