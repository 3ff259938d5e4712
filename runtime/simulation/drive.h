// SPDX-License-Identifier: Apache-2.0
// The drive's side of the device link: session, watchdog and supervision in front of the simulated
// device, with faults to order. Knows no socket: datagrams come in and go out as bytes.
//
// Laws (tests/runtime/simulation/drive_test.cpp):
//  1. Torques are other than zero only while the newest accepted command is one of mode torque, not
//     older than the watchdog's time (real clock), and no emergency stop is pressed. Once watchdog
//     or stop have taken them away they stay at zero until a command has come that has seen a
//     state which says so and that asks for none: neither commands that were on their way nor a
//     host's own way down bring them back.
//  2. A refused datagram changes nothing but a count.
//  3. While a session is alive no other one begins.
//  4. Lock-step: time goes on by one of the host's periods a torque command, and by nothing else.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "formats/session/device_protocol.h"
#include "runtime/simulation/fault_plan.h"
#include "runtime/simulation/simulated_device.h"

namespace trocar::runtime {

struct DriveOptions {
  LinkKey key;
  LinkClock clock = LinkClock::kReal;
  double period_s = 2.5e-4;  ///< of the drive's own clock
  /// Silence of commands after which torques are zero; for a slow host 2.5 of its periods, if that
  /// is longer.
  double watchdog_s = 0.01;
  /// Silence after which a session is over: nothing is sent to it any more. Lock-step: after which
  /// another host may have the drive.
  double session_s = 1;
  FaultPlan faults;
  std::size_t record_steps = 0;  ///< kept at most in DriveReport::steps
};

/// What the drive did in one step of its world.
struct DriveStep {
  std::uint64_t session = 0;  ///< from 1
  double t_s = 0;             ///< the world's, at the step's end
  DriveMode mode = DriveMode::kReady;
  std::uint8_t motor_faults = 0;
  bool fault = false;                 ///< some fault of the plan was on at the step's begin
  std::uint64_t command_taken = 0;    ///< as in StatePacket
  double commanded_max_Nm = 0;        ///< largest of the motors, as commanded
  double applied_max_Nm = 0;          ///< and as applied
  std::uint64_t packets_refused = 0;  ///< so far
};

/// A time at which the hand felt a force give way.
struct FeltPeak {
  double t_s = 0;
  double force_N = 0;
};

/// What happened at the drive, and what the simulated hand felt of it.
struct DriveReport {
  std::uint64_t sessions = 0;
  LinkCounts packets;
  std::uint64_t commands_missed = 0;  ///< never accepted: lost, or overtaken
  std::uint64_t watchdog_trips = 0;   ///< that took a torque away
  std::uint64_t stale_commands = 0;   ///< before such a one (law 1)
  std::uint64_t emergency_stops = 0;
  double largest_torque_Nm = 0;     ///< applied
  double largest_hand_force_N = 0;  ///< of the hand on the tool's tip, any direction
  std::vector<FeltPeak> peaks;      ///< the first kMaxPeaks
  std::vector<DriveStep> steps;     ///< the first DriveOptions::record_steps
  static constexpr std::size_t kMaxPeaks = 4096;
};

class Drive {
 public:
  /// Sessions that want a fresh world get a copy of `model`.
  Drive(const DriveOptions& options, SimulatedDevice model);

  struct Answer {
    std::array<std::uint8_t, kLargestPacketBytes> bytes{};
    std::size_t size = 0;  ///< 0: no answer
    std::span<const std::uint8_t> view() const noexcept { return {bytes.data(), size}; }
  };

  /// One datagram; `answer` is for its sender. kNone: it was taken; `from_host` then says whether
  /// it was a command of the session, whose sender is where states belong.
  LinkRefusal receive(std::span<const std::uint8_t> datagram, std::int64_t now_ns, Answer& answer,
                      bool& from_host) noexcept;

  /// Real clock: `periods` of the drive's periods have gone by (held-up ones are made up for, as
  /// the world does not wait). `answer`: the state for the host, if there is a session.
  void tick(std::int64_t now_ns, int periods, Answer& answer) noexcept;

  bool in_session() const noexcept { return session_.has_value(); }
  double session_time_s() const noexcept { return model_.truth().t_s; }
  DriveMode mode() const noexcept { return mode_; }
  /// A `kill` of the plan is due.
  bool must_die() const noexcept;
  const SimulatedDevice& model() const noexcept { return model_; }
  const DriveReport& report() const noexcept { return report_; }

 private:
  struct Session {
    LinkKey key;
    LinkNonce host_nonce{}, drive_nonce{};
    std::uint64_t number = 0;
    double period_s = 0;    ///< the host's
    double watchdog_s = 0;  ///< for it
    bool fresh = false;
    std::uint64_t last_command = 0, last_state = 0;
    /// Law 1: the first state that says it; 0: nothing is to be said.
    std::uint64_t told_from = 0;
    std::int64_t last_command_ns = 0;
  };
  bool is_alive(std::int64_t now_ns) const noexcept;
  void offer(const HelloPacket& hello, std::int64_t now_ns, Answer& answer) noexcept;
  void begin(Session offered) noexcept;
  void take(const CommandPacket& command, std::int64_t now_ns, Answer& answer) noexcept;
  void end_session() noexcept;
  void advance(double dt_s) noexcept;
  void judge_stop() noexcept;
  void supervise(double dt_s) noexcept;
  void feel() noexcept;
  void send_state(Answer& answer) noexcept;
  void take_away(DriveMode mode) noexcept;
  bool plans(FaultKind kind) const noexcept;
  void keep_step(bool fault) noexcept;

  static constexpr std::size_t kOffers = 4;

  DriveOptions options_;
  SimulatedDevice fresh_, model_;
  std::optional<Session> session_;
  std::array<std::optional<Session>, kOffers> offers_;
  std::size_t next_offer_ = 0;
  DeviceCommand command_;
  std::array<double, kMotors> not_following_s_{};
  std::array<std::optional<double>, kEncoders> stuck_at_rad_;
  double peak_N_ = 0, peak_t_s_ = 0, valley_N_ = 0;
  DriveReport report_;
  DriveMode mode_ = DriveMode::kReady;
  std::uint8_t motor_faults_ = 0;
  bool stop_pressed_ = false;
  bool falls_ = false;  ///< the felt force, after a peak
};

}  // namespace trocar::runtime
