// SPDX-License-Identifier: Apache-2.0
// The requirements of a scene, a part of `trocar-run check`: the bytes that are loaded and kept
// in memory, the motor torques that the tissues' threshold forces need and, with the force law
// `network`, the time to prepare the prefetched stiffness.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/scene.h"
#include "runtime/contact/sheet.h"
#include "runtime/device/hand_device.h"
#include "runtime/session/session_options.h"

namespace trocar::runtime {

struct LoadedBytes {
  std::uint64_t asset = 0;  ///< size of the asset's file
  std::uint64_t read = 0;   ///< number of bytes of the file that were read
  std::size_t asset_slices = 0;
};

/// Texts about one slice, without the last line feed.
struct SliceRequirements {
  std::string mesh;   ///< height, size and tissue
  std::string force;  ///< torques and stiffness at one pose of the tool
};
struct SceneRequirements {
  std::string scene;  ///< lines about the whole scene
  std::vector<SliceRequirements> slices;
  /// Why the loop may oscillate or give energy to the hand; empty: no such reason is known.
  std::string stability_warning;
};

/// Describes the requirements. `sheets`: result of place_slices(). `T_device_plate`:
/// for each sheet, a pose of the plate at which the tool touches this sheet. Errors:
/// those of make_force_law().
Result<SceneRequirements> describe_requirements(
    const Scene& scene, const DeviceSpecification& device,
    const std::vector<std::unique_ptr<const Sheet>>& sheets,
    const std::vector<Pose>& T_device_plate, const LoadedBytes& bytes,
    const SessionOptions& options);

}  // namespace trocar::runtime
