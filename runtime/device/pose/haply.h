// SPDX-License-Identifier: Apache-2.0
// The connection to a Haply Inverse3, and the messages of Haply's service.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/faults.h"
#include "runtime/device/link/udp_link.h"
#include "runtime/device/pose/connected_device.h"

namespace trocar::runtime {

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

struct HaplyAnswer {
  enum class Kind : std::uint8_t {
    kState,
    kUnusable,  ///< the text is malformed, or one of the devices is missing
    kNotReady,  ///< the service reports that one of the devices cannot be used any more
  };
  Kind kind = Kind::kUnusable;
  /// kState only, without a time. `p_m`: each coordinate is from -10 m to 10 m. `q`: the norm is 1
  /// within 1e-3; without a grip it is the identity. `buttons`: bit 0: button a, button_0 or the only
  /// button; bit 1: b or button_1; bit 2: c or button_2; bit 3: button_3.
  PoseReading state;
  std::string why;  ///< other kinds only: the reason, such as "it does not list device 049D"
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

// The connection to a Haply Inverse3, a desktop haptic device. The maker's program, the Haply
// Inverse service (versions 3.1 and 3.5), drives the device and exchanges messages with this class
// through a WebSocket. An exchange sends a message with a force, and the service answers with the
// state of the devices. The haptic thread must not call these functions, because
// they block. The class has no thread of its own. Its asynchronous operations run only within
// open(), exchange() and close(). Each operation has a time limit, so that these functions return.

/// The address of the service. `host` is the host's name as the user gave it, for messages;
/// `endpoint` is the resolved address with the port.
struct HaplyAddress {
  std::string host = "localhost";
  Endpoint endpoint{0x7f000001, 10001};
};

/// Parses what follows "haply:" in a URI: [HOST[:PORT]], by default localhost:10001. Resolves HOST
/// to an IPv4 address. Errors: kUsage if the text has another form or HOST is unknown. The message
/// is one line that begins with the URI.
Result<HaplyAddress> parse_haply_address(std::string_view text);

struct HaplyOptions {
  HaplyAddress address;
  SayLine say;  ///< receives lines about devices that were found, or for which open() waits
  /// True: open() fails without a VerseGrip, a handle that measures its orientation. False: a
  /// VerseGrip is used only if it is ready when open() first finds an arm that is ready.
  bool wants_rotation = false;
  double open_timeout_s = kOpenTimeout_s;
};

/// A reading's position is that of the cursor, the point that the Inverse3 measures, in the
/// service's application space. A reading's orientation and buttons are those of
/// a VerseGrip. The force acts on the cursor. Moments are not rendered.
class HaplyConnection final : public PoseConnection {
 public:
  explicit HaplyConnection(HaplyOptions options);
  /// Calls close().
  ~HaplyConnection() override;
  HaplyConnection(const HaplyConnection&) = delete;
  HaplyConnection& operator=(const HaplyConnection&) = delete;

  /// Chooses the first arm (an Inverse3) of the service's list, and the first grip (a VerseGrip)
  /// that is ready. Waits at most open_timeout_s until the chosen devices are ready. If no grip is
  /// ready and wants_rotation is false, open() continues without a grip. A later call chooses the
  /// same devices again.
  Result<void> open() override;
  /// If the service's answer is unusable (HaplyAnswer), the force is sent again immediately.
  /// Errors, in addition to those of PoseConnection::exchange(): five unusable answers in a row;
  /// the arm or the grip is no longer ready; the force is not finite.
  Result<PoseReading> exchange(const HandleWrench& wrench) override;
  FaultDetail refused_contents() const noexcept override { return refused_; }
  void close() noexcept override;

  /// After open(): true if readings have a measured orientation.
  bool senses_rotation() const { return devices_ && devices_->grip; }

 private:
  struct Socket;
  using Instant = std::chrono::steady_clock::time_point;
  Error fault(const std::string& why) const { return {ExitCode::kDeviceFault, uri_ + ": " + why}; }
  void say(const std::string& line) const {
    if (options_.say) options_.say(uri_ + ": " + line);
  }
  Result<void> connect(Instant until);
  /// Waits for an inventory (the service's list of its devices) in which the chosen
  /// devices are ready.
  Result<HaplyDevices> find_devices(Instant until);
  /// Chooses the devices. Returns the reason why they cannot be used yet; empty: they can be used.
  std::string choose(const HaplyInventory& inventory, HaplyDevices& chosen) const;
  /// Passes lines about the devices to HaplyOptions::say, such as their ids and unusual settings.
  void describe(const HaplyInventory& inventory, const HaplyDevices& chosen) const;
  Result<PoseReading> command(const HaplyDevices& devices, const std::array<double, 3>& force_N);

  HaplyOptions options_;
  std::string uri_;                      ///< the device's URI, with which each error begins
  std::optional<HaplyDevices> devices_;  ///< devices that the first open() chose
  std::unique_ptr<Socket> socket_;
  FaultDetail refused_;  ///< of the last exchange()
};

}  // namespace trocar::runtime
