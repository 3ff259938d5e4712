// SPDX-License-Identifier: Apache-2.0
// Loads a scene's bone as the console shows it: the asset, and where the asset's slices lie in {B}.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/base/result.h"
#include "formats/session/scene.h"
#include "runtime/contact/sheet.h"

namespace trocar::runtime {

struct PlacedBone {
  Scene scene;
  Asset asset;  ///< the part of the asset that the scene uses: its slices, with one mesh each
  std::vector<std::unique_ptr<const Sheet>> sheets;
  std::vector<AssetSurface> surfaces;
  /// All slices of the asset, also those that the scene does not use. Empty if load_bone() has read
  /// only the scene's slices (BoneParts).
  std::vector<AssetSlice> all;
};

/// The parts of an asset that load_bone() reads. kForView: the scene's slices, with HU at their
/// vertices; if the asset has a surface, also the surface and all other slices. kWithVolumes: the
/// whole asset, with its volumes of HU.
enum class BoneParts : std::uint8_t { kForView, kWithVolumes };

/// Returns the JSON text in a .glb file. Errors: kRefused if the file is not binary glTF, or if the
/// text exceeds 64 MiB.
Result<std::string> glb_json(const std::filesystem::path& file);

/// Loads a scene and its bone. If `asset` is not empty, it replaces the asset that the scene names.
/// Errors: kRefused if trocar-run would refuse the scene or the asset.
Result<PlacedBone> load_bone(const std::filesystem::path& scene_file,
                             const std::filesystem::path& asset, BoneParts parts);

/// Returns the slice of the asset with this slice index. Precondition: the slice exists.
const AssetSlice& slice_of(const Asset& asset, int index);

/// Returns the transform from the patient's frame (LPS) to the frame of the topmost sheet's slice
/// (u, v and the slice normal), both in mm. Errors: kRefused if the sheets do not lie relative to
/// each other as in the scan; the message is a sentence that says why.
Result<Eigen::Affine3d> plane_of_surface(const PlacedBone& loaded);

/// Returns the transform from the patient's frame (LPS, mm) to {B} (m), including the scale from mm
/// to m. Errors: those of plane_of_surface().
Result<Eigen::Affine3d> device_of_patient(const PlacedBone& loaded);

}  // namespace trocar::runtime
