// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/open_device.h"

#include "runtime/device/four_legs/four_legs.h"
#include "runtime/device/link/link_key.h"
#include "runtime/device/link/udp_link.h"
#include "runtime/device/pose/force_dimension.h"
#include "runtime/device/pose/haply.h"
#include "runtime/session/pose_session.h"

namespace trocar::runtime {

HandTrajectory hand_trajectory(const Scene& scene) {
  HandTrajectory trajectory;
  for (const TipKeyframe& keyframe : scene.hand.trajectory) {
    HandKeyframe frame;
    frame.t_s = keyframe.t_s;
    frame.T_device_tool.p_m = Eigen::Vector3d(keyframe.tip_m.data());
    frame.T_device_tool.q = from_rotation_vector(Eigen::Vector3d(keyframe.rotation_deg.data()) *
                                                 (std::numbers::pi / 180));
    trajectory.keyframes.push_back(frame);
  }
  return trajectory;
}

HandImpedance hand_impedance(const SceneHand& hand) {
  HandImpedance impedance = hand.grip == HandGrip::kLight   ? kLightGrip
                            : hand.grip == HandGrip::kStiff ? kStiffGrip
                                                            : HandImpedance{};
  impedance.stiffness_N_per_m = hand.stiffness_N_per_m.value_or(impedance.stiffness_N_per_m);
  impedance.damping_Ns_per_m = hand.damping_N_s_per_m.value_or(impedance.damping_Ns_per_m);
  impedance.rotational_stiffness_Nm_per_rad =
      hand.rotation_stiffness_Nm_per_rad.value_or(impedance.rotational_stiffness_Nm_per_rad);
  impedance.rotational_damping_Nms_per_rad =
      hand.rotation_damping_Nm_s_per_rad.value_or(impedance.rotational_damping_Nms_per_rad);
  impedance.mass_kg = hand.mass_kg.value_or(impedance.mass_kg);
  impedance.let_go_t_s = hand.let_go_t_s.value_or(impedance.let_go_t_s);
  return impedance;
}

namespace {

/// The targets of `hand`, or of the scene's keyframes if it is null.
HandMotion hand_motion(const Scene& scene, UnscriptedHand* hand) {
  return hand != nullptr ? HandMotion(std::ref(*hand)) : HandMotion(hand_trajectory(scene));
}

Result<OpenedDevice> open_simulated(std::string_view, const OpenDeviceOptions& options) {
  if (options.scene.hand.live != (options.hand != nullptr))
    return bug("the simulated device needs exactly one hand");
  if (const auto* device = std::get_if<PoseDeviceDescription>(&options.description)) {
    auto made = make_simulated_pose_device(options.scene, *device, options.hand);
    if (!made) return made.error().after(options.scene_name + ": ");
    return make_pose_hand(*device, options.scene,
                          std::make_unique<SimulatedPoseDevice>(std::move(*made)));
  }
  const auto& description = *std::get_if<DeviceDescription>(&options.description);
  auto made = make_simulated_device(options.scene, description, options.hand);
  if (!made) return made.error().after(options.scene_name + ": ");
  return make_four_legs(description, std::make_unique<SimulatedDevice>(std::move(*made)));
}

/// Returns the options of the link to a device process.
Result<UdpLinkOptions> link_options(const char* scheme, std::string_view address,
                                    const OpenDeviceOptions& options) {
  const Result<Endpoint> peer = parse_endpoint(address, 1);
  if (!peer) return peer.error().after(std::string("--device ") + scheme + ": ");
  const Result<LinkKey> key = read_link_key(options.key_file);
  if (!key) return key.error();
  UdpLinkOptions link;
  link.peer = *peer;
  link.key = *key;
  link.period_s = 1 / options.rate_Hz;
  if (options.is_simulated) link.no_state_s = kSimulatedNoData_s;
  link.clock = options.clock == Clock::kReal ? LinkClock::kReal : LinkClock::kLockStep;
  link.say = options.say;
  return link;
}

Result<OpenedDevice> open_udp(std::string_view address, const OpenDeviceOptions& options) {
  const Result<UdpLinkOptions> link = link_options("udp", address, options);
  if (!link) return link.error();
  Result<std::unique_ptr<UdpDevice>> made = UdpDevice::make(*link);
  if (!made) return made.error();
  return make_four_legs(*std::get_if<DeviceDescription>(&options.description), std::move(*made));
}

Result<OpenedDevice> open_pose_drive(std::string_view address, const OpenDeviceOptions& options) {
  const Result<UdpLinkOptions> link = link_options("pose", address, options);
  if (!link) return link.error();
  Result<std::unique_ptr<UdpPoseDevice>> made = UdpPoseDevice::make(*link);
  if (!made) return made.error();
  return make_pose_hand(*std::get_if<PoseDeviceDescription>(&options.description), options.scene,
                        std::move(*made));
}

/// Makes a hand device of a connection, which exchanges twice in each tick so that no state is older than a tick.
OpenedDevice make_connected(std::unique_ptr<PoseConnection> connection,
                            const OpenDeviceOptions& options) {
  return make_pose_hand(
      *std::get_if<PoseDeviceDescription>(&options.description), options.scene,
      std::make_unique<ConnectedDevice>(std::move(connection), 0.5 / options.rate_Hz, options.say));
}

Result<void> needs_real_clock(const char* uri, const OpenDeviceOptions& options) {
  if (options.clock == Clock::kReal) return {};
  return usage(std::string("--clock virtual: ") + uri + " runs by its own clock; use --clock real");
}

Result<OpenedDevice> open_haply(std::string_view address, const OpenDeviceOptions& options) {
  if (auto real = needs_real_clock("haply:", options); !real) return real.error();
  const Result<HaplyAddress> parsed = parse_haply_address(address);
  if (!parsed) return parsed.error();
  const auto& description = *std::get_if<PoseDeviceDescription>(&options.description);
  return make_connected(std::make_unique<HaplyConnection>(
                            HaplyOptions{*parsed, options.say, description.senses_rotation}),
                        options);
}

Result<OpenedDevice> open_force_dimension(std::string_view address,
                                          const OpenDeviceOptions& options) {
  if (auto real = needs_real_clock("forcedimension:", options); !real) return real.error();
  const Result<int> id = parse_force_dimension_address(address);
  if (!id) return id.error();
  const auto& description = *std::get_if<PoseDeviceDescription>(&options.description);
  return make_connected(
      std::make_unique<ForceDimension>(ForceDimensionOptions{
          *id, options.say, description.senses_rotation, description.moment_max_Nm > 0, true}),
      options);
}

/// Opens a connection and asks whether it measures the orientation of its handle.
template <typename Connection>
Result<bool> senses_rotation(Connection& connection) {
  const Result<void> opened = connection.open();
  const bool senses = opened && connection.senses_rotation();
  connection.close();
  if (!opened) return opened.error();
  return senses;
}

Result<bool> haply_senses_rotation(std::string_view address) {
  const Result<HaplyAddress> parsed = parse_haply_address(address);
  if (!parsed) return parsed.error();
  HaplyConnection connection(HaplyOptions{*parsed, {}, false});
  return senses_rotation(connection);
}

Result<bool> force_dimension_senses_rotation(std::string_view address) {
  const Result<int> id = parse_force_dimension_address(address);
  if (!id) return id.error();
  ForceDimension connection(ForceDimensionOptions{*id, {}, true, false, false});
  return senses_rotation(connection);
}

/// The kinds of description that a URI needs.
enum class DescriptionKind : std::uint8_t {
  kAny,        ///< the simulated device in the process is either
  kFourLegs,   ///< encoders and motors
  kPoseDevice  ///< a device that measures its own pose
};

struct DeviceKind {
  std::string_view uri;  ///< SCHEME or SCHEME:ADDRESS, as shown in the help text
  std::string_view help;
  bool needs_key_file, may_have_motors;
  DescriptionKind description;
  std::string_view built_in;  ///< name of the description of a pose device
  /// Asks the device whether it measures the orientation of its handle. Null only if there is no
  /// built-in description.
  Result<bool> (*senses_rotation)(std::string_view address);
  Result<OpenedDevice> (*open)(std::string_view address, const OpenDeviceOptions& options);
};

constexpr DeviceKind kDevices[] = {
    {"inproc", "simulated in this process", false, false, DescriptionKind::kAny, "", nullptr,
     open_simulated},
    {"udp:HOST:PORT", "another process that drives the device, such as trocar-device-sim", true,
     true, DescriptionKind::kFourLegs, "", nullptr, open_udp},
    {"pose:HOST:PORT",
     "another process that drives a device that measures its own pose (position and rotation)",
     true, true, DescriptionKind::kPoseDevice, "", nullptr, open_pose_drive},
    {"haply:[HOST[:PORT]]", "a Haply Inverse3 through the Haply Inverse service", false, true,
     DescriptionKind::kPoseDevice, "haply_inverse3", haply_senses_rotation, open_haply},
    {"forcedimension:[ID]",
     "a device of Force Dimension, through the maker's library (SDK), which must be installed",
     false, true, DescriptionKind::kPoseDevice, "force_dimension", force_dimension_senses_rotation,
     open_force_dimension},
};

static_assert(std::all_of(std::begin(kDevices), std::end(kDevices), [](const DeviceKind& kind) {
  return kind.open != nullptr && kind.built_in.empty() == (kind.senses_rotation == nullptr);
}));

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

Result<SimulatedDevice> make_simulated_device(const Scene& scene,
                                              const DeviceDescription& description,
                                              UnscriptedHand* hand,
                                              const std::optional<MechanicsOptions>& mechanics) {
  SimulatedDeviceOptions options;
  options.mechanics = mechanics;
  options.T_plate_tool.p_m = Eigen::Vector3d(scene.tool.tip_in_plate_m.data());
  return SimulatedDevice::make(description, hand_motion(scene, hand), hand_impedance(scene.hand),
                               options);
}

PoseFrame pose_frame(const PoseDeviceDescription& description, const Scene& scene) {
  const std::vector<HandKeyframe> path = hand_trajectory(scene).keyframes;
  if (path.empty()) return {description, Pose{}};
  const Tool tool = make_tool(scene.tool);
  Eigen::AlignedBox3d box;
  for (const HandKeyframe& each : path)
    box.extend(each.T_device_tool.p_m - each.T_device_tool.q * tool.tip_plate_m);
  return {description, Pose{box.center(), path.front().T_device_tool.q}};
}

Result<SimulatedPoseDevice> make_simulated_pose_device(const Scene& scene,
                                                       const PoseDeviceDescription& description,
                                                       UnscriptedHand* hand) {
  Pose T_plate_tool;
  T_plate_tool.p_m = Eigen::Vector3d(scene.tool.tip_in_plate_m.data());
  return SimulatedPoseDevice::make(description, pose_frame(description, scene),
                                   hand_motion(scene, hand), hand_impedance(scene.hand),
                                   T_plate_tool);
}

bool may_have_motors(std::string_view uri) {
  const DeviceKind* kind = find_device(uri);
  return kind != nullptr && kind->may_have_motors;
}

bool is_device_process(std::string_view uri) {
  const DeviceKind* kind = find_device(uri);
  return kind != nullptr && kind->needs_key_file;
}

Result<void> check_device_uri(std::string_view uri, bool has_key_file) {
  const DeviceKind* const kind = find_device(uri);
  if (kind == nullptr) {
    return usage("--device " + std::string(uri) + ": must be " +
                 uris([](const DeviceKind&) { return true; }));
  }
  if (kind->needs_key_file && !has_key_file)
    return usage("--device " + std::string(uri) + ": needs --key-file");
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

OpenedDevice make_pose_hand(const PoseDeviceDescription& description, const Scene& scene,
                            std::unique_ptr<PoseDevice> pose_device) {
  OpenedDevice opened;
  opened.pose_device = std::move(pose_device);
  opened.device =
      std::make_unique<PoseHand>(description, pose_frame(description, scene), *opened.pose_device);
  return opened;
}

Result<std::shared_ptr<HandDevice>> simulate_device(const Scene& scene,
                                                    const AnyDeviceDescription& description) {
  const OpenDeviceOptions options{.scene = scene,
                                  .scene_name = "the simulated device",
                                  .description = description,
                                  .key_file = {},
                                  .say = {}};
  Result<OpenedDevice> made = open_simulated("", options);
  if (!made) return made.error();
  const auto opened = std::make_shared<OpenedDevice>(std::move(*made));
  return std::shared_ptr<HandDevice>(opened, opened->device.get());
}

std::unique_ptr<DeviceSpecification> make_specification(const AnyDeviceDescription& description,
                                                        const Scene& scene) {
  if (const auto* device = std::get_if<PoseDeviceDescription>(&description))
    return std::make_unique<PoseSpecification>(*device, pose_frame(*device, scene));
  return std::make_unique<FourLegsSpecification>(*std::get_if<DeviceDescription>(&description));
}

Result<OpenedDevice> open_device(std::string_view uri, const OpenDeviceOptions& options) {
  if (auto checked = check_device_uri(uri, !options.key_file.empty()); !checked)
    return checked.error();
  const DeviceKind& kind = *find_device(uri);
  const bool is_pose_device = std::holds_alternative<PoseDeviceDescription>(options.description);
  if (kind.description != DescriptionKind::kAny &&
      (kind.description == DescriptionKind::kPoseDevice) != is_pose_device) {
    return usage("--device " + std::string(uri) + ": " +
                 (is_pose_device
                      ? "has encoders and motors, and the device description is that of a "
                        "device that measures its own pose"
                      : "measures its own pose; give its --device-description "
                        "(docs/add-your-device.md)"));
  }
  return kind.open(split(uri).address, options);
}

std::string_view built_in_description(std::string_view uri) {
  const DeviceKind* kind = find_device(uri);
  return kind != nullptr ? kind->built_in : std::string_view();
}

Result<std::string> find_built_in_description(std::string_view uri) {
  const DeviceKind* kind = find_device(uri);
  if (kind == nullptr || kind->built_in.empty()) return std::string();
  const Result<bool> turns = kind->senses_rotation(split(uri).address);
  if (!turns) return turns.error();
  return std::string(kind->built_in) + (*turns ? std::string(kWithRotation) : "");
}

std::string device_uri_help() {
  std::string text;
  for (const DeviceKind& kind : kDevices) {
    if (!text.empty()) text += ";\n";
    text.append(kind.uri).append(": ").append(kind.help);
  }
  return text;
}

}  // namespace trocar::runtime
