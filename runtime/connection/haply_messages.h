// SPDX-License-Identifier: Apache-2.0
// The JSON messages of the Haply Inverse service, versions 3.1 and 3.5, as plain data. Text from the service
// is not trusted: sizes, nesting, types, numbers and ids are checked here. Members that are not used here may
// have any form.
//
// The service sends one inventory when a client connects, then exactly one state for each message that it receives. A force
// holds until the next message. Positions are in m and forces in N, in the frame that the service calls application space:
// by default x to the right, y forward, z up, and the origin at the base of the device.
// Source: docs.haply.co/inverseSDK/service, pages "WebSocket Protocol", "Control Commands", "Device Configuration".
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"

namespace trocar::runtime {

/// Longest message of the service that is accepted. An inventory has about 2 kB for each device.
inline constexpr std::size_t kMaxHaplyMessageBytes = 256 << 10;
/// Longest message to the service.
inline constexpr std::size_t kMaxHaplyCommandBytes = 512;

/// The member that holds the force in a message: {"values": ...} in version 3.1, {"vector": ...} in 3.5.
enum class HaplySpelling : std::uint8_t { kValues, kVector, kBoth };

/// A device in the messages.
struct HaplyDevice {
  std::string
      list;  ///< key of the list that holds it: "inverse3", "inverse3x", "minverse", "verse_grip", ...
  std::string id;  ///< 1 to 64 letters, digits and -_.:
  friend bool operator==(const HaplyDevice&, const HaplyDevice&) = default;
};

/// A device that measures a position and renders a force.
struct HaplyArm {
  HaplyDevice device;
  /// Spelling of the version that is recognised from the arm's state; kBoth: the version is not recognised.
  HaplySpelling spelling = HaplySpelling::kBoth;
  std::string handedness;  ///< "left" or "right"; empty: not stated
  /// False: the service rotates, moves, scales or mirrors the arm's coordinates.
  bool has_default_frame = true;
  /// Gain of the filter with which the service reduces forces when it detects an oscillation.
  std::optional<double> force_gate_gain;
  std::string problem;  ///< why it cannot be used yet, and what to do; empty: it is ready
};

/// A handle that measures an orientation and has buttons.
struct HaplyGrip {
  HaplyDevice device;
  std::string problem;  ///< why it cannot be used, and what to do; empty: it is ready
};

/// All devices of a message, in its order.
struct HaplyInventory {
  std::vector<HaplyArm> arms;
  std::vector<HaplyGrip> grips;
};

/// Reads an inventory. Errors: (refused) one line that says why the text is not an inventory of version 3.1 or 3.5.
Result<HaplyInventory> parse_haply_inventory(std::string_view text);

/// The devices of a session.
struct HaplyDevices {
  HaplyDevice arm;
  std::optional<HaplyDevice> grip;
  HaplySpelling spelling = HaplySpelling::kVector;
};

/// A state of the devices of a session.
struct HaplyState {
  std::array<double, 3> p_m{};          ///< each coordinate within 10 m
  std::array<double, 4> q{1, 0, 0, 0};  ///< w x y z, unit within 1e-3; identity without a grip
  std::uint32_t buttons = 0;            ///< bits 0, 1, 2: buttons a, b, c, or the only one
};

struct HaplyAnswer {
  enum class Kind : std::uint8_t {
    kState,
    kUnusable,  ///< the text is malformed, or one of the devices is missing
    kNotReady,  ///< the service states that one of the devices cannot be used any more
  };
  Kind kind = Kind::kUnusable;
  HaplyState state;  ///< kState only
  std::string why;   ///< otherwise: one clause, such as "it does not list device 049D"
};

/// Reads a state.
HaplyAnswer parse_haply_answer(std::string_view text, const HaplyDevices& devices);

/// Returns the message that commands a force of finite numbers. The numbers have enough digits for the service to
/// read exactly these doubles.
std::string haply_force_message(const HaplyDevices& devices, const std::array<double, 3>& force_N);

/// Returns the message that requests an inventory and commands nothing.
std::string haply_inventory_request();

}  // namespace trocar::runtime
