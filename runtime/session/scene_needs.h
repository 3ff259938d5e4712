// SPDX-License-Identifier: Apache-2.0
// What a scene needs (a part of `trocar-run --check`, scene_check.h): bytes loaded and kept,
// torques at the threshold force, and the time to prepare a response of its force law.
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
  std::uint64_t asset = 0;  ///< of the asset's file
  std::uint64_t read = 0;   ///< of these, read
  std::size_t asset_slices = 0;
};

/// Text without the last line feed.
struct SliceNeeds {
  std::string mesh;   ///< place, size and tissue
  std::string force;  ///< torques and response, with the tool at a place
};
struct SceneNeeds {
  std::string scene;  ///< lines
  std::vector<SliceNeeds> slices;
};

/// Where the tool is taken to touch a sheet: the plate's pose with the tip in the sheet's plane.
/// Over the anchor, upright:
Pose over_anchor(const Sheet& sheet, const Tool& tool) noexcept;

/// `sheets` as from place_slices, `T_device_plate` a place for each. Refused: with the force law
/// `network`, a tissue or tool for which calibration finds no membrane.
Result<SceneNeeds> describe_needs(const Scene& scene, const DeviceDescription& device,
                                  const std::vector<std::unique_ptr<const Sheet>>& sheets,
                                  const std::vector<Pose>& T_device_plate, const LoadedBytes& bytes,
                                  double rate_Hz, double duration_s);

/// Bytes kept for a sheet during the session: two replicas and its first version.
std::uint64_t kept_bytes(const Sheet& sheet) noexcept;

}  // namespace trocar::runtime
