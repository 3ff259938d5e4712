// SPDX-License-Identifier: Apache-2.0
// The messages of the service: commands for one tick and requests for full states from a client; states, in a full
// message with the configurations as well, to it.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace stand_in {

enum class Protocol { kV31, kV35 };

/// Id of the only arm.
inline constexpr std::string_view kDeviceId = "049D";

struct CommandMessage {
  bool is_valid = false;                   ///< JSON whose top level is an object
  std::optional<Eigen::Vector3d> force_N;  ///< sum of all forces for the arm
  bool is_misspelt = false;         ///< it has a force in the spelling of the other version only
  bool has_unusable_force = false;  ///< a force has no three finite numbers
  bool wants_config = false;
};

/// Never throws. Unknown members and other commands are ignored, as the protocol has many.
CommandMessage parse_command(std::string_view text, Protocol protocol);

/// Content of the list of arms.
enum class ArmList { kNormal, kEmpty, kMissing };

/// Numbers of the arm and of the grip.
struct Measured {
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_m_per_s = Eigen::Vector3d::Zero();
  Eigen::Vector3d force_N = Eigen::Vector3d::Zero();  ///< that acts, after the force gate
  bool is_idle = true;
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();
  std::uint32_t buttons = 0;
};

struct StateMessage {
  Protocol protocol = Protocol::kV35;
  bool has_config = false;
  std::optional<int> session_id;
  std::string_view device_id = kDeviceId;
  double force_gate_gain = 0;
  bool in_use = false, is_ready = true;
  Measured measured;
  std::string_view coordinate;  ///< stands for each coordinate of the position if it is not empty
  ArmList arms = ArmList::kNormal;
  bool has_grip = false;
};

/// Numbers have the precision of float, as those of the service.
std::string text_of(const StateMessage& message);

}  // namespace stand_in
