// SPDX-License-Identifier: Apache-2.0
// What a client sends over the WebSocket: commands for one tick, configuration, and requests for full states.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "tests/stand_ins/haply/arm.h"

namespace trocar::haply_stand_in {

enum class Protocol { kV31, kV35 };

struct Dialect {
  Protocol protocol = Protocol::kV35;
  bool accepts_both = false;  // version 3.5 also takes a force in the spelling of version 3.1
  std::string device_id;      // the arm that obeys
};

struct CommandMessage {
  bool is_valid = false;            // JSON whose top level is an object
  std::optional<Vec3> force_N;      // sum of all forces for the arm
  bool is_misspelt = false;         // it has a force in the spelling of the other version only
  bool has_unusable_force = false;  // a force has no three finite numbers
  bool names_other_device = false;
  bool wants_inverse3_config = false, wants_grip_config = false;
  std::optional<double> force_gate_gain;
  std::string preset;  // empty if not set
};

/// True for the gains that the force gate accepts: 0 switches it off.
inline bool is_gain(double gain) {
  return gain >= 0 && gain < 1;
}

/// Never throws. Unknown members and other commands are ignored, as the protocol has many.
CommandMessage parse_command(std::string_view text, const Dialect& dialect);

}  // namespace trocar::haply_stand_in
