// SPDX-License-Identifier: Apache-2.0
// What the stand-in has received: a CSV file of all forces, and a summary in JSON.
#pragma once

#include <cstdint>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "tests/stand_ins/haply/command_message.h"
#include "tests/stand_ins/haply/fault.h"

namespace trocar::haply_stand_in {

struct Counts {
  std::uint64_t clients = 0, messages = 0, answers = 0;
  std::uint64_t forces = 0;         // messages with an accepted force
  std::uint64_t idle_messages = 0;  // valid messages without a force
  std::uint64_t invalid_messages = 0;
  std::uint64_t misspelt_forces = 0;
  std::uint64_t unusable_forces = 0;  // not three finite numbers
  std::uint64_t over_limit_forces = 0;
  std::uint64_t other_device = 0;  // messages that name another device than the first arm
  std::uint64_t protocol_errors =
      0;  // connections that ended for a message that was too large or broke the protocol
  double largest_force_N = 0;
};

class Journal {
 public:
  /// Empty names: no file. Throws std::runtime_error if the log cannot be written.
  Journal(const std::string& log, std::string summary, double force_limit_N);

  /// Takes a message. `t_s` is the time since the first force; `arm` already has the state at this time.
  void take(const CommandMessage& message, double t_s, const Arm& arm);
  /// Writes what is still to be written. Throws std::runtime_error if a file cannot be written.
  void finish(const std::vector<Fault>& faults, double t_s);

  Counts counts;

 private:
  void log_force(const Vec3& force_N, double t_s, const Arm& arm);

  struct Closer {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::string log_name_, summary_;
  /// Holds the log until finish(): a disk can block for longer than a client waits for its device.
  std::vector<char> buffer_;
  std::unique_ptr<std::FILE, Closer> log_;
  double force_limit_N_;
  Vec3 last_force_N_{};
  double last_force_s_ = 0;
  bool ends_with_force_ = false;
};

}  // namespace trocar::haply_stand_in
