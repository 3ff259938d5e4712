// SPDX-License-Identifier: Apache-2.0
// The console's answers in binary form: container, bone, recording and HU (protocol.md).
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"

namespace trocar::runtime {

// Makes the container in which the console sends binary data: JSON and then arrays (protocol.md).

/// Collects the arrays of one container and makes the container.
class Arrays {
 public:
  /// Appends an array, aligned to the size of its numbers. Returns two values: the offset of the
  /// array in bytes from the start of the first array, and the count of its numbers.
  template <typename Number>
  std::array<std::size_t, 2> add(const std::vector<Number>& numbers) {
    bytes_.resize((bytes_.size() + sizeof(Number) - 1) / sizeof(Number) * sizeof(Number));
    const std::size_t at = bytes_.size();
    bytes_.append(reinterpret_cast<const char*>(numbers.data()), numbers.size() * sizeof(Number));
    return {at, numbers.size()};
  }
  /// Returns the whole container: the length of the JSON as four bytes, the JSON, and the arrays.
  /// The JSON ends with blanks, so that the arrays begin at a multiple of 8 bytes.
  std::string with_json(std::string_view json) const {
    std::string out(4, '\0');
    out += json;
    out.resize((out.size() + 7) / 8 * 8, ' ');
    const auto size = static_cast<std::uint32_t>(out.size() - 4);
    std::memcpy(out.data(), &size, sizeof size);
    return out += bytes_;
  }

 private:
  std::string bytes_;
};

/// Returns the JSON text in a .glb file. Errors: kRefused if the file is not binary glTF, or if the
/// text exceeds 64 MiB.
Result<std::string> glb_json(const std::filesystem::path& file);

// Encodes the bone of a scene for display, in {B}: the sheets and the surface of the whole bone, if
// the asset has one. If the scene has moved slices relative to each other, the surface does not fit
// them, and is left out.

/// Returns the answer of /api/bone (protocol.md). If `asset` is not empty, it replaces the asset
/// that the scene names. Errors: kRefused if trocar-run would
/// refuse the scene or the asset.
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

// Encodes a recording for playback on a page.

/// Returns the answer of /api/recording (protocol.md). Errors: those of parse_recording(); kRefused
/// if the file has more than 2 GiB, or if the recording has X-ray but does not state the rate of
/// its ticks, from which the time of screening is computed.
Result<std::string> rows_of(const std::filesystem::path& recording);

// Encodes the HU of a scene's scan, and their positions in {B}, the device's frame. The console's
// page makes X-ray pictures and planes of the CT from them.

/// Returns the answer of /api/volume (protocol.md). If `asset` is not empty, it replaces the asset
/// that the scene names. Errors: kRefused if trocar-run would
/// refuse the scene or the asset.
Result<std::string> volume_of(const std::filesystem::path& scene_file,
                              const std::filesystem::path& asset);

}  // namespace trocar::runtime
