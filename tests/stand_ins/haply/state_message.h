// SPDX-License-Identifier: Apache-2.0
// What the service sends: the states of all devices, in a full message with their configurations as well.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "tests/stand_ins/haply/command_message.h"

namespace trocar::haply_stand_in {

enum class Grip { kNone, kVerseGrip, kWireless };

/// Content of the list of arms.
enum class ArmList { kNormal, kEmpty, kMissing, kOnlySecond, kNoState };

/// Numbers of the arm and of the grip. Plain data, so that an earlier one can be sent once more.
struct Measured {
  Vec3 position_m{}, velocity_m_per_s{};
  Vec3 force_N{};  // the force that acts, after the force gate
  bool is_idle = true;
  Quaternion orientation{1, 0, 0, 0};
  unsigned buttons = 0;
};

struct StateMessage {
  Protocol protocol = Protocol::kV35;
  bool has_inverse3_config = false, has_grip_config = false;
  std::optional<int> session_id;
  std::string_view device_id, handedness, preset;
  double force_gate_gain = 0;
  bool in_use = false, is_ready = true;
  Measured measured;
  std::string_view coordinate;  // stands for each coordinate of the position if it is not empty
  ArmList arms = ArmList::kNormal;
  bool has_second_device = false;
  Grip grip = Grip::kNone;
  bool numbers_buttons = false;  // buttons of a wireless grip are button_0.. instead of a, b, c
};

/// Id of a second arm, which never moves and is 0.2 m from the usual start of the first one.
inline constexpr const char* kSecondDevice = "0A2C";

/// Numbers have the precision of float, as those of the service.
std::string text_of(const StateMessage& message);

}  // namespace trocar::haply_stand_in
