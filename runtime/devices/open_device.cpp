// SPDX-License-Identifier: Apache-2.0
#include "runtime/devices/open_device.h"

#include <utility>

#include "runtime/devices/simulated_hand.h"
#include "runtime/link/link_key.h"
#include "runtime/link/udp_device.h"
#include "runtime/mechanism/four_legs.h"

namespace trocar::runtime {
namespace {

/// Longest stall of a simulated drive that does not end a session, as on a machine with other work.
constexpr double kSimulatedNoState_s = 0.25;

Result<OpenedDevice> open_simulated(std::string_view, const OpenDeviceOptions& options) {
  if (options.scene.hand.live != (options.hand != nullptr))
    return bug("the simulated device needs exactly one hand");
  Result<SimulatedDevice> made =
      options.hand == nullptr
          ? make_simulated_device(options.scene, options.description)
          : make_simulated_device(options.scene, options.description, *options.hand);
  if (!made) return Error{made.error().code, options.scene_name + ": " + made.error().message};
  return make_four_legs(options.description, std::make_unique<SimulatedDevice>(std::move(*made)));
}

Result<OpenedDevice> open_udp(std::string_view address, const OpenDeviceOptions& options) {
  const Result<Endpoint> peer = parse_endpoint(address, 1);
  if (!peer) return Error{peer.error().code, "--device udp: " + peer.error().message};
  const Result<LinkKey> key = read_link_key(options.key_file);
  if (!key) return key.error();
  UdpDeviceOptions link;
  link.peer = *peer;
  link.key = *key;
  link.period_s = 1 / options.rate_Hz;
  if (options.is_simulated) link.no_state_s = kSimulatedNoState_s;
  link.clock = options.clock == Clock::kReal ? LinkClock::kReal : LinkClock::kLockStep;
  Result<std::unique_ptr<UdpDevice>> made = UdpDevice::make(link);
  if (!made) return made.error();
  return make_four_legs(options.description, std::move(*made));
}

struct DeviceKind {
  std::string_view uri;  ///< SCHEME or SCHEME:ADDRESS, as shown in the help text
  std::string_view help;
  bool needs_key_file, may_have_motors;
  Result<OpenedDevice> (*open)(std::string_view address, const OpenDeviceOptions& options);
};

constexpr DeviceKind kDevices[] = {
    {"inproc", "simulated in the process", false, false, open_simulated},
    {"udp:HOST:PORT", "a device process, such as\ntrocar-device-sim", true, true, open_udp},
};

struct UriParts {
  std::string_view scheme, address;
  bool has_address;
};
UriParts split(std::string_view uri) {
  const std::size_t colon = uri.find(':');
  if (colon == std::string_view::npos) return {uri, {}, false};
  return {uri.substr(0, colon), uri.substr(colon + 1), true};
}

/// Returns the device with this URI; null: there is none.
const DeviceKind* find_device(std::string_view uri) {
  const UriParts wanted = split(uri);
  for (const DeviceKind& kind : kDevices) {
    const UriParts known = split(kind.uri);
    if (known.scheme == wanted.scheme && known.has_address == wanted.has_address) return &kind;
  }
  return nullptr;
}

/// Returns the URIs of the chosen devices, such as "inproc or udp:HOST:PORT".
template <typename Choose>
std::string uris(Choose&& choose) {
  std::string text;
  for (const DeviceKind& kind : kDevices) {
    if (!choose(kind)) continue;
    if (!text.empty()) text += " or ";
    text += kind.uri;
  }
  return text;
}

}  // namespace

bool may_have_motors(std::string_view uri) {
  const DeviceKind* kind = find_device(uri);
  return kind != nullptr && kind->may_have_motors;
}

Result<void> check_device_uri(std::string_view uri, bool has_key_file) {
  const DeviceKind* const kind = find_device(uri);
  if (kind == nullptr) {
    return usage("--device " + std::string(uri) + ": must be " +
                 uris([](const DeviceKind&) { return true; }));
  }
  if (kind->needs_key_file && !has_key_file) {
    return usage("--device " + std::string(uri) + ": needs --key-file");
  }
  if (!kind->needs_key_file && has_key_file) {
    return usage("--key-file: is for --device " +
                 uris([](const DeviceKind& each) { return each.needs_key_file; }) + " only");
  }
  return {};
}

OpenedDevice make_four_legs(const DeviceDescription& description,
                            std::unique_ptr<Device> encoders_and_motors) {
  OpenedDevice opened;
  opened.encoders_and_motors = std::move(encoders_and_motors);
  opened.device = std::make_unique<FourLegs>(description, *opened.encoders_and_motors);
  return opened;
}

Result<OpenedDevice> open_device(std::string_view uri, const OpenDeviceOptions& options) {
  if (auto checked = check_device_uri(uri, !options.key_file.empty()); !checked) {
    return checked.error();
  }
  return find_device(uri)->open(split(uri).address, options);
}

std::string device_uri_help() {
  std::string text;
  for (const DeviceKind& kind : kDevices) {
    if (!text.empty()) text += "; ";
    text.append(kind.uri).append(": ").append(kind.help);
  }
  return text;
}

}  // namespace trocar::runtime
