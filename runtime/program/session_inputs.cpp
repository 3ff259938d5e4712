// SPDX-License-Identifier: Apache-2.0
#include "runtime/program/session_inputs.h"

#include <filesystem>
#include <string>
#include <utility>

#include "formats/asset/asset.h"
#include "formats/asset/one_sheet.h"
#include "formats/session/procedures.h"
#include "runtime/bone_cutting/material/bone_volume.h"

namespace trocar::runtime {
namespace {

Result<Scene> load_scene(const RunArguments& arguments) {
  Result<Scene> scene = read_scene(arguments.scene);
  if (!scene) return scene.error();
  if (!arguments.asset.empty()) scene->asset = arguments.asset;
  if (const auto law = force_law_from_string(arguments.force_law)) scene->force_law.kind = *law;
  if (const Procedure* procedure = find_procedure(arguments.procedure)) {
    const Strength strength = strength_from_string(arguments.strength).value_or(Strength::kMedian);
    if (const auto applied = apply_procedure(*procedure, strength, *scene); !applied)
      return refused(arguments.scene + ": " + applied.error().message);
  }
  if (arguments.coupling_N_per_m) {
    scene->force_law.axis = ToolAxis::kCoupled;
    scene->force_law.coupling_N_per_m = *arguments.coupling_N_per_m;
  }
  if (!arguments.description.empty()) scene->device = arguments.description;
  if (scene->body && !traits_of(scene->force_law.kind).uses_bone_volume)
    return refused(arguments.scene + ": has a body, which is for the force law cutting");
  return scene;
}

/// Loads the slices of the asset that the scene uses.
Result<AssetPart> load_asset(const RunArguments& arguments, const Scene& scene) {
  std::vector<int> slice_indices;
  for (const SceneSlice& slice : scene.slices)
    slice_indices.push_back(slice.index);
  if (const auto& body = scene.body) {
    for (int index = body->from; index <= body->to; ++index)
      slice_indices.push_back(index);
  }
  Result<AssetPart> part = read_asset_part(scene.asset, std::move(slice_indices));
  if (part) return part;
  std::error_code ignored;
  const bool is_missing = arguments.asset.empty() && !std::filesystem::exists(scene.asset, ignored);
  return Error{
      part.error().code,
      part.error().message + (is_missing ? " (the scene's asset; --asset names another)" : "")};
}

}  // namespace

Result<DeviceDescription> read_description(const std::filesystem::path& file) {
  if (file.empty()) return default_device_description();
  return read_device_description(file.string());
}

Result<SessionInputs> load_inputs(const RunArguments& arguments) {
  SessionInputs inputs;
  Result<Scene> scene = load_scene(arguments);
  if (!scene) return scene.error();
  inputs.scene = std::move(*scene);
  if (inputs.scene.force_law.kind == ForceLawKind::kCutting)
    if (const auto resolved = resolve_layers(inputs.scene); !resolved)
      return refused(arguments.scene + ": " + resolved.error().message);
  Result<DeviceDescription> description = read_description(inputs.scene.device.value_or(""));
  if (!description) return description.error();
  inputs.description = std::move(*description);

  Result<AssetPart> part = load_asset(arguments, inputs.scene);
  if (!part) return part.error();
  const std::string asset = inputs.scene.asset.string();
  add_hu_at_vertices(part->asset);
  if (const auto ok = weld_materials(part->asset, asset); !ok) return ok.error();
  if (const auto ok = place_body(inputs.scene, part->asset, asset); !ok) return ok.error();
  auto sheets = place_slices(inputs.scene, part->asset, asset);
  if (!sheets) return sheets.error();
  inputs.sheets = std::move(*sheets);
  inputs.tissues = choose_tissues(inputs.scene, part->asset);
  inputs.bytes = {part->file_bytes, part->read_bytes, part->asset_slices};

  if (!arguments.replay.empty()) {
    Result<std::vector<RecordingRow>> rows =
        read_recording(arguments.replay, &inputs.replay_origin);
    if (!rows) return rows.error();
    inputs.replay = std::move(*rows);
  }
  return inputs;
}

}  // namespace trocar::runtime
