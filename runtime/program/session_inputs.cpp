// SPDX-License-Identifier: Apache-2.0
#include "runtime/program/session_inputs.h"

#include <cstdio>

#include "formats/base/text.h"
#include "runtime/haptics/bone/bone_volume.h"
#include "runtime/session/origin.h"

namespace trocar::runtime {
namespace {

Result<Scene> load_scene(const RunArguments& arguments) {
  Result<Scene> scene = read_scene(arguments.scene);
  if (!scene) return scene.error();
  if (!arguments.asset.empty()) scene->asset = arguments.asset;
  if (arguments.force_law) scene->force_law.kind = *arguments.force_law;
  if (const Procedure* procedure = find_procedure(arguments.procedure)) {
    if (const auto applied = apply_procedure(*procedure, arguments.strength, *scene); !applied)
      return refused(arguments.scene + ": " + applied.error().message);
  }
  if (const CouplingOptions& coupling = arguments.session.coupling; coupling.on) {
    scene->force_law.axis = ToolAxis::kCoupled;
    scene->force_law.coupling_N_per_m = coupling.stiffness_N_per_m;
  }
  if (!arguments.description.empty()) scene->device = arguments.description;
  if (scene->body && !traits_of(scene->force_law.kind).uses_bone_volume)
    return refused(arguments.scene + ": has a body, which is for the force law cutting");
  return scene;
}

/// Loads the slices of the asset that the scene uses.
Result<AssetPart> load_asset(const RunArguments& arguments, const Scene& scene) {
  Result<AssetPart> part = read_asset_part(scene.asset, used_slices(scene));
  if (part) return part;
  std::error_code ignored;
  const bool is_missing = arguments.asset.empty() && !std::filesystem::exists(scene.asset, ignored);
  return Error{
      part.error().code,
      part.error().message + (is_missing ? " (the scene's asset; --asset names another)" : "")};
}

/// Returns the name of the built-in description for the value of --device; empty: there is none.
Result<std::string> built_in_name(std::string_view uri, HandleOrientation orientation) {
  const std::string_view name = built_in_description(uri);
  if (name.empty() || orientation == HandleOrientation::kAssumed) return std::string(name);
  return find_built_in_description(uri);
}

/// Loads the description of the session's device. A scene's own description does not replace the built-in one of a device of another
/// maker; the command line's does.
Result<void> load_device(const RunArguments& arguments, SessionInputs& inputs) {
  std::string built_in;
  if (const auto stated = read_pose_device_origin(inputs.replay_origin)) {
    built_in = stated->built_in.value_or("");
  } else {
    const bool is_asked = !arguments.is_check && arguments.description.empty();
    const Result<std::string> name = built_in_name(
        arguments.device, is_asked ? HandleOrientation::kAsked : HandleOrientation::kAssumed);
    if (!name) return name.error();
    built_in = *name;
  }
  const bool uses_file =
      inputs.scene.device && (!arguments.description.empty() || built_in.empty());
  if (uses_file) {
    const std::string file = inputs.scene.device->string();
    Result<AnyDeviceDescription> read = read_any_device_description(file);
    if (!read) return read.error();
    if (auto* legs = std::get_if<DeviceDescription>(&*read)) {
      inputs.description = std::move(*legs);
      return {};
    }
    const Result<std::string> digest = digest_of(file);
    if (!digest) return digest.error();
    inputs.pose_device = std::move(*std::get_if<PoseDeviceDescription>(&*read));
    inputs.pose_device_origin = *digest;
  } else if (!built_in.empty()) {
    if (const auto ok = built_in_pose_device(built_in).into(inputs.pose_device); !ok)
      return ok.error();
    inputs.pose_device_origin = "built-in/" + built_in;
  }
  inputs.description = default_device_description();
  return {};
}

/// Gives a description without a delay that of the recording which is replayed, or that of a device
/// outside this process: a tick.
void set_delay(const RunArguments& arguments, SessionInputs& inputs) {
  std::optional<double>& delay_s =
      inputs.pose_device ? inputs.pose_device->delay_s : inputs.description.delay_s;
  if (delay_s) return;
  if (!arguments.replay.empty()) {
    delay_s = inputs.replay_origin.number(kOriginDelay);
    // A recording is not trusted.
    if (delay_s && !(*delay_s >= 0 && *delay_s <= kLongestDelay_s)) delay_s.reset();
    return;
  }
  AnyDeviceDescription device = inputs.device();
  assume_delay(arguments.device,
               arguments.rate_Hz.value_or(inputs.scene.rate_Hz.value_or(kDefaultRate_Hz)), device);
  delay_s = std::visit([](const auto& each) { return each.delay_s; }, device);
}

/// Sets the largest force and the force scale: those of the command line, those of a recording that
/// is replayed, or what fits the device. If a replay's differ from the recording's, check_replay()
/// refuses them.
Result<void> fit_forces(const RunArguments& arguments, SessionInputs& inputs) {
  double& scale = inputs.scene.force_law.force_scale;
  scale = arguments.force_scale.value_or(scale);
  if (!inputs.pose_device) {
    if (arguments.force_limit_N)
      return usage("--force-limit: is for a device that measures its own pose");
    return {};
  }
  // A recording of an earlier version may state that it was made with this option.
  const CompensationOptions& compensation = arguments.session.compensation;
  if (arguments.replay.empty() && (compensation.friction || compensation.gravity))
    return usage("--compensate: is not for a device that measures its own pose");
  PoseDeviceDescription& device = *inputs.pose_device;
  if (const auto stated = read_pose_device_origin(inputs.replay_origin)) {
    scale = arguments.force_scale.value_or(stated->force_scale);
    device.force_max_N = arguments.force_limit_N.value_or(stated->force_max_N);
    return {};
  }
  if (arguments.force_limit_N) {
    if (*arguments.force_limit_N > device.force_max_N)
      return usage("--force-limit: is above the force_max_N of the device description");
    device.force_max_N = *arguments.force_limit_N;
  }
  if (arguments.force_scale) return {};
  const double rate_Hz = arguments.rate_Hz.value_or(inputs.scene.rate_Hz.value_or(kDefaultRate_Hz));
  const Result<double> fitting = fitting_force_scale(device, inputs.scene, inputs.sheets, rate_Hz);
  if (!fitting) return fitting.error();
  if (*fitting < scale && !arguments.quiet)
    print(stderr,
          "trocar-run: note: %s gets at most %.4g N, and the scene's tissue resists with up "
          "to %.3g N: forces "
          "are rendered at %.3g of their size (--force-scale)\n",
          device.name, device.force_max_N, device.force_max_N / *fitting, *fitting);
  scale = *fitting;
  return {};
}

}  // namespace

Result<AnyDeviceDescription> read_description(const std::filesystem::path& file,
                                              std::string_view uri, HandleOrientation orientation) {
  if (!file.empty()) return read_any_device_description(file.string());
  const Result<std::string> built_in = built_in_name(uri, orientation);
  if (!built_in) return built_in.error();
  if (built_in->empty()) return AnyDeviceDescription(default_device_description());
  Result<PoseDeviceDescription> made = built_in_pose_device(*built_in);
  if (!made) return made.error();
  return AnyDeviceDescription(std::move(*made));
}

void assume_delay(std::string_view uri, double rate_Hz, AnyDeviceDescription& description) {
  if (uri == kDefaultDevice) return;
  std::visit([&](auto& device) { device.delay_s = device.delay_s.value_or(1 / rate_Hz); },
             description);
}

Result<SessionInputs> load_inputs(const RunArguments& arguments) {
  SessionInputs inputs;
  if (const auto ok = load_scene(arguments).into(inputs.scene); !ok) return ok.error();
  if (inputs.scene.force_law.kind == ForceLawKind::kCutting)
    if (const auto resolved = resolve_layers(inputs.scene); !resolved)
      return refused(arguments.scene + ": " + resolved.error().message);
  if (!arguments.replay.empty()) {
    Result<std::vector<RecordingRow>> rows =
        read_recording(arguments.replay, &inputs.replay_origin, &inputs.replay_is_cut);
    if (!rows) return rows.error();
    inputs.replay = std::move(*rows);
  }
  if (const auto loaded = load_device(arguments, inputs); !loaded) return loaded.error();
  set_delay(arguments, inputs);

  Result<AssetPart> part = load_asset(arguments, inputs.scene);
  if (!part) return part.error();
  const std::string asset = inputs.scene.asset.string();
  add_hu_at_vertices(part->asset);
  if (const auto ok = weld_materials(part->asset, asset); !ok) return ok.error();
  if (const auto ok = place_body(inputs.scene, part->asset, asset); !ok) return ok.error();
  if (const auto ok = place_slices(inputs.scene, part->asset, asset).into(inputs.sheets); !ok)
    return ok.error();
  inputs.tissues = choose_tissues(inputs.scene, part->asset);
  inputs.bytes = {part->file_bytes, part->read_bytes, part->asset_slices};

  if (const auto fitted = fit_forces(arguments, inputs); !fitted) return fitted.error();
  return inputs;
}

}  // namespace trocar::runtime
