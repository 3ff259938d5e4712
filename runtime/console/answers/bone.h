// SPDX-License-Identifier: Apache-2.0
// The bone of a scene in {B}, for display: the sheets, and the asset's surface. The position of the
// surface is defined if the scene's slices lie relative to each other as in the scan; otherwise the
// surface is left out.
// Tests: tests/e2e/console_server_test.py
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"

namespace trocar::runtime {

/// Returns the answer of /api/bone (protocol.md). If `asset` is not empty, it replaces the scene's
/// own asset. Errors: those of load_bone() (placed_bone.h).
Result<std::string> bone_of(const std::filesystem::path& scene_file,
                            const std::filesystem::path& asset);

/// Position of a scene's bone in the patient, and the asset's surface there. The frame is RAS, as in 3D
/// Slicer: x to the right of the patient, y to the front, z to the head.
struct PatientBone {
  /// Transform from {B} to the patient's frame, both in mm. None: the scene has moved slices relative
  /// to each other, so there is no such transform.
  std::optional<Eigen::Affine3d> T_patient_device;
  /// The surface, if the asset has one and its position is defined: x, y, z of each vertex in mm.
  std::vector<float> vertices_mm;
  std::vector<std::uint32_t> triangles;  ///< three vertices each
};
/// Arguments and errors are those of bone_of().
Result<PatientBone> patient_bone_of(const std::filesystem::path& scene_file,
                                    const std::filesystem::path& asset);

}  // namespace trocar::runtime
