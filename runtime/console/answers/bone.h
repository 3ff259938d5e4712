// SPDX-License-Identifier: Apache-2.0
// Encodes the bone of a scene for display, in {B}: the sheets and the surface of the whole bone, if
// the asset has one. If the scene has moved slices relative to each other, the surface does not fit
// them, and is left out.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"

namespace trocar::runtime {

/// Returns the answer of /api/bone (protocol.md). If `asset` is not empty, it replaces the asset
/// that the scene names. Errors: those of load_bone() (placed_bone.h).
Result<std::string> bone_of(const std::filesystem::path& scene_file,
                            const std::filesystem::path& asset);

/// Position of a scene's bone in the patient, and the asset's surface in the patient's frame. The
/// frame is RAS, as in 3D Slicer: x to the right of the patient, y to the front, z to the head.
struct PatientBone {
  /// Transform from {B} to the patient's frame, both in mm. Nullopt if the scene has moved slices
  /// relative to each other, because there is then no such transform.
  std::optional<Eigen::Affine3d> T_patient_device;
  /// The surface: x, y, z of each vertex in mm. Empty if the asset has no surface, or if
  /// T_patient_device is nullopt.
  std::vector<float> vertices_mm;
  std::vector<std::uint32_t> triangles;  ///< three vertex indices for each triangle
};
/// Returns the bone in the patient's frame. Arguments and errors are those of bone_of().
Result<PatientBone> patient_bone_of(const std::filesystem::path& scene_file,
                                    const std::filesystem::path& asset);

}  // namespace trocar::runtime
