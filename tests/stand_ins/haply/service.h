// SPDX-License-Identifier: Apache-2.0
// The service without its sockets: it takes messages of clients and gives the answers to send.
#pragma once

#include <chrono>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "tests/stand_ins/haply/arm.h"
#include "tests/stand_ins/haply/command_message.h"
#include "tests/stand_ins/haply/fault.h"
#include "tests/stand_ins/haply/journal.h"
#include "tests/stand_ins/haply/state_message.h"

namespace trocar::haply_stand_in {

struct ServiceSettings {
  Dialect dialect;
  ArmSettings arm;
  std::vector<Keyframe> keyframes;
  std::vector<Fault> faults;
  std::string handedness = "right";
  Grip grip = Grip::kNone;
  bool numbers_buttons = false, has_second_device = false;
  double force_gate_gain = 0;  // of a new session
  double force_limit_N = 5;    // larger forces are counted
  std::string log, summary;
};

enum class Act { kSend, kStaySilent, kReset, kClose, kRestart };

struct Answer {
  Act act = Act::kSend;
  std::string bytes;
  bool is_binary = false;
  int copies = 1;
  double delay_s = 0;    // before it is sent
  double restart_s = 0;  // how long no socket is open
};

class Service {
 public:
  using Clock = std::chrono::steady_clock;

  explicit Service(ServiceSettings settings);

  /// A client has connected. Returns its session, and in `inventory` the full message for it.
  int begin_session(Answer& inventory);
  /// Takes one message and returns the answer to it.
  Answer receive(int session, std::string_view text);
  /// A client has gone. The arm is without force from then on if it was the client's.
  void end_session(int session, bool by_protocol_error);
  /// Writes log and summary. Throws std::runtime_error if a file cannot be written.
  void finish();

  /// The state with the configuration of all devices, for the HTTP interface.
  std::string inventory() const;
  Protocol protocol() const { return settings_.dialect.protocol; }
  const std::string& device_id() const { return settings_.dialect.device_id; }
  /// Gains of the force gate of the sessions, by the session's number.
  std::map<int, double>& force_gates() { return force_gates_; }
  double default_force_gate() const { return settings_.force_gate_gain; }

 private:
  double now_s() const;
  void advance();
  void apply(int session, const CommandMessage& message);
  StateMessage state() const;
  Answer answer(StateMessage message);
  static void spoil_payload(FaultKind kind, Answer& answer);

  ServiceSettings settings_;
  Journal journal_;
  Arm arm_;
  std::map<int, double> force_gates_;
  int last_session_ = 0;
  std::string preset_ = "defaults";
  bool has_started_ = false;  // by the first force
  Clock::time_point start_, advanced_;
  Vec3 applied_N_{};       // after the force gate
  int force_session_ = 0;  // whose force it is; 0: idle
  Measured shown_;         // the numbers of the last answer
};

}  // namespace trocar::haply_stand_in
