// SPDX-License-Identifier: Apache-2.0
// The service without its sockets: it takes messages of clients, keeps a log of forces, and gives the answers to send.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "tests/stand_ins/faults.h"
#include "tests/stand_ins/haply/messages.h"
#include "tests/stand_ins/simulated_arm.h"

namespace stand_in {

/// Kinds of faults with their meanings.
inline constexpr std::array<std::array<std::string_view, 2>, 20> kFaultKinds{{
    {"silence", "the service reads but does not answer"},
    {"late", "the answer comes 30 ms late"},
    {"twice", "two answers for one message"},
    {"garbage", "text that is not JSON"},
    {"truncated", "the first half of a state"},
    {"binary", "a binary frame of 64 bytes"},
    {"huge", "a state with 2 MB of padding"},
    {"deep", "100,000 lists inside each other"},
    {"wrong-types", "coordinates of the position are strings"},
    {"nan", "coordinates of the position are NaN"},
    {"big-number", "coordinates of the position are 1e300"},
    {"jump", "the position is 50 mm away in x"},
    {"frozen", "the numbers of the state before are repeated"},
    {"other-id", "the arm has another device_id"},
    {"removed", "the list of arms is empty"},
    {"no-inverse3", "there is no list of arms"},
    {"not-ready", "status.ready is false"},
    {"disconnect", "the connection is reset (TCP RST)"},
    {"close", "the WebSocket is closed properly"},
    {"restart", "no socket is open for DURATION, 1 s by default; all clients are disconnected"},
}};

struct ServiceSettings {
  Protocol protocol = Protocol::kV35;
  ArmSettings arm{0.2, 1, 300, 8};
  std::vector<Keyframe> path;
  std::vector<Fault> faults;
  Readings readings;
  bool has_grip = false;
  double force_gate_gain = 0;
  std::string log, summary;  ///< files; empty: none
};

enum class Act { kSend, kStaySilent, kReset, kClose, kRestart };

struct Answer {
  Act act = Act::kSend;
  std::string bytes;
  bool is_binary = false;
  int copies = 1;
  double delay_s = 0;    ///< before it is sent
  double restart_s = 0;  ///< how long no socket is open
};

class Service {
 public:
  using Clock = std::chrono::steady_clock;

  /// Throws std::runtime_error if the log cannot be written.
  explicit Service(ServiceSettings settings);

  /// A client has connected. Returns its session, and in `inventory` the full message for it.
  int begin_session(Answer& inventory);
  /// Takes one message and returns the answer to it.
  Answer receive(int session, std::string_view text);
  /// A client has gone. The arm is without force from then on if it was the client's.
  void end_session(int session);
  /// Writes log and summary. Throws std::runtime_error if a file cannot be written.
  void finish();

 private:
  double now_s() const;
  void advance();
  void apply(int session, const CommandMessage& message);
  void keep(const CommandMessage& message);
  StateMessage state();
  Answer answer(StateMessage message);
  Fault* take_fault(double now_s);

  ServiceSettings settings_;
  SimulatedArm arm_;
  /// Holds the log until finish(): a disk can block for longer than a client waits for its device.
  std::vector<char> log_buffer_;
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> log_{nullptr, std::fclose};
  std::uint64_t messages_ = 0, answers_ = 0, forces_ = 0, invalid_ = 0, misspelt_ = 0,
                unusable_ = 0;
  int last_session_ = 0;
  bool has_started_ = false;  ///< by the first force
  Clock::time_point start_, advanced_;
  Eigen::Vector3d applied_N_ = Eigen::Vector3d::Zero();  ///< after the force gate
  int force_session_ = 0;                                ///< whose force it is; 0: idle
  Measured shown_;                                       ///< the numbers of the last answer
};

}  // namespace stand_in
