// SPDX-License-Identifier: Apache-2.0
// What a scene needs (`trocar-run --check`): bytes loaded and kept, torques at the threshold force,
// and the time to prepare a response of its force law.
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

/// Returns lines of text. `sheets` as from place_slices. Refused: with the force law `network`, a
/// tissue or tool for which calibration finds no membrane.
Result<std::string> describe_needs(const Scene& scene, const DeviceDescription& device,
                                   const std::vector<std::unique_ptr<const Sheet>>& sheets,
                                   const LoadedBytes& bytes, double rate_Hz, double duration_s);

/// Bytes kept for a sheet during the session: two replicas and its first version.
std::uint64_t kept_bytes(const Sheet& sheet) noexcept;

}  // namespace trocar::runtime
