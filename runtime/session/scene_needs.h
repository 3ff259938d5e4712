// SPDX-License-Identifier: Apache-2.0
// What a scene loads, what it asks of the motors, and what its force law costs, said before
// anything runs (`trocar-run --check`).
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "formats/session/device_description.h"
#include "formats/base/result.h"
#include "formats/session/scene.h"
#include "runtime/contact/sheet.h"

namespace trocar::runtime {

struct LoadedBytes {
  std::uint64_t asset = 0;  ///< of the asset's file
  std::uint64_t read = 0;   ///< of these, what was read
  std::size_t asset_slices = 0;
};

/// Lines of text. `sheets` as from place_slices. Errors: by `network`, a tissue or tool that no
/// membrane fits (refused).
Result<std::string> describe_needs(const Scene& scene, const DeviceDescription& device,
                                   const std::vector<std::unique_ptr<const Sheet>>& sheets,
                                   const LoadedBytes& bytes, double rate_Hz, double duration_s);

/// Bytes that a sheet keeps for the whole session: two replicas and what it was at first.
std::uint64_t kept_bytes(const Sheet& sheet) noexcept;

}  // namespace trocar::runtime
