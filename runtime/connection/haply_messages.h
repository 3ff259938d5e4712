// SPDX-License-Identifier: Apache-2.0
// Reads and writes the JSON messages of the Haply Inverse service, versions 3.1 and 3.5. Text from
// the service is not trusted: the functions check sizes, nesting, types, numbers and ids. Members
// of a message that are not used here may have any form.
//
// When a client connects, the service sends an inventory: the list of its devices with their
// properties. Then it answers each message with exactly one message. The answer contains the state
// (measured values) of the devices, or after haply_inventory_request() the inventory. A commanded
// force holds until the next message. Positions are in m and forces in N, in the frame that the
// service calls application space: by default x points to the right, y forward and z up, and the
// origin is at the base of the device.
// Source: docs.haply.co/inverseSDK/service, pages "WebSocket Protocol", "Control Commands" and
// "Device Configuration".
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/fault_words.h"

namespace trocar::runtime {

/// Longest message that is accepted from the service. An inventory has about 2 kB for each device.
inline constexpr std::size_t kMaxHaplyMessageBytes = 256 << 10;
/// Longest message to the service.
inline constexpr std::size_t kMaxHaplyCommandBytes = 512;

/// Name of the member that holds the force in a message: "values" in version 3.1, "vector" in
/// version 3.5. With kBoth, the message contains both members.
enum class HaplySpelling : std::uint8_t { kValues, kVector, kBoth };

/// A device, as messages name it.
struct HaplyDevice {
  /// Key of the JSON list that holds the device: "inverse3", "inverse3x", "verse_grip", ...
  std::string list;
  std::string id;  ///< 1 to 64 letters, digits and -_.:
  friend bool operator==(const HaplyDevice&, const HaplyDevice&) = default;
};

/// A device that measures a position and renders a force.
struct HaplyArm {
  HaplyDevice device;
  /// Spelling that the service's version uses. In the inventory, each arm has an object "state". In
  /// version 3.1 this object has a member "mode", and in version 3.5 "control_mode" or
  /// "control_domain". If it has none of them, the spelling is kBoth.
  HaplySpelling spelling = HaplySpelling::kBoth;
  std::string handedness;  ///< "left" or "right"; empty: not stated
  /// False if the service rotates, moves, scales or mirrors the arm's coordinates.
  bool has_default_frame = true;
  /// Gain of the filter with which the service reduces forces when it detects an oscillation;
  /// nullopt if the service states none.
  std::optional<double> force_gate_gain;
  std::string problem;  ///< why the arm cannot be used yet, and what to do; empty: the arm is ready
};

/// A handle that measures an orientation and has buttons.
struct HaplyGrip {
  HaplyDevice device;
  /// Why the grip cannot be used yet, and what to do; empty: the grip is ready.
  std::string problem;
};

/// All devices that a message lists, in the message's order.
struct HaplyInventory {
  std::vector<HaplyArm> arms;
  std::vector<HaplyGrip> grips;
};

/// Parses an inventory. Errors: kRefused if the text is not an inventory of version 3.1 or 3.5. The
/// error message says in one line why it is not.
Result<HaplyInventory> parse_haply_inventory(std::string_view text);

/// The devices that a connection uses.
struct HaplyDevices {
  HaplyDevice arm;
  std::optional<HaplyDevice> grip;  ///< nullopt: the connection uses no grip
  HaplySpelling spelling = HaplySpelling::kVector;
};

/// The measured values in one state of an arm and a grip.
struct HaplyState {
  std::array<double, 3> p_m{};  ///< position; each coordinate is from -10 m to 10 m
  /// Orientation w x y z; the norm is 1 within 1e-3. Without a grip it is the identity.
  std::array<double, 4> q{1, 0, 0, 0};
  /// Bit 0: button a, button_0 or the only button. Bit 1: b or button_1. Bit 2: c or button_2.
  /// Bit 3: button_3.
  std::uint32_t buttons = 0;
};

struct HaplyAnswer {
  enum class Kind : std::uint8_t {
    kState,
    kUnusable,  ///< the text is malformed, or one of the devices is missing
    kNotReady,  ///< the service reports that one of the devices cannot be used any more
  };
  Kind kind = Kind::kUnusable;
  HaplyState state;  ///< kState only
  std::string why;   ///< other kinds only: the reason, such as "it does not list device 049D"
  /// kUnusable because of what the text states of the devices: kRefusedState with the field.
  FaultDetail refused;
};

/// Parses the service's answer to a message as a state of `devices`.
HaplyAnswer parse_haply_answer(std::string_view text, const HaplyDevices& devices);

/// Returns the message that commands a force. Precondition: the force is finite. The components
/// are written with enough digits for the service to read exactly the same doubles.
std::string haply_force_message(const HaplyDevices& devices, const std::array<double, 3>& force_N);

/// Returns the message that requests an inventory and commands nothing.
std::string haply_inventory_request();

}  // namespace trocar::runtime
