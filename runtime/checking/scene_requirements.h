// SPDX-License-Identifier: Apache-2.0
// The requirements of a scene (a part of `trocar-run --check`): bytes loaded and kept, torques at the
// threshold force, and the time to prepare the prefetched stiffness of its force law.
// Tests: tests/e2e/scene_check_e2e_test.py
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/device_description.h"
#include "formats/session/scene.h"
#include "runtime/contact/sheet.h"

namespace trocar::runtime {

struct LoadedBytes {
  std::uint64_t asset = 0;  ///< size of the asset's file
  std::uint64_t read = 0;   ///< bytes of it that were read
  std::size_t asset_slices = 0;
};

/// Text without the last line feed.
struct SliceRequirements {
  std::string mesh;   ///< height, size and tissue
  std::string force;  ///< torques and stiffness at one pose of the tool
};
struct SceneRequirements {
  std::string scene;  ///< lines
  std::vector<SliceRequirements> slices;
};

/// `sheets` come from place_slices(); `T_device_plate` is a pose for each. Refused: with the force law
/// `network`, a tissue or tool for which calibration finds no membrane.
Result<SceneRequirements> describe_requirements(
    const Scene& scene, const DeviceDescription& device,
    const std::vector<std::unique_ptr<const Sheet>>& sheets,
    const std::vector<Pose>& T_device_plate, const LoadedBytes& bytes, double rate_Hz,
    double duration_s);

/// Bytes kept for a sheet during the session: two replicas and its first version.
std::uint64_t kept_bytes(const Sheet& sheet) noexcept;

}  // namespace trocar::runtime
