// SPDX-License-Identifier: GPL-3.0-or-later
// Describes an asset, for `trocar-mesh info`.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>

#include "formats/asset/asset.h"

namespace trocar::pipeline {

/// The JSON that `info` prints (formats/session/info.schema.json). For each slice and material, it
/// has the position, the numbers of vertices, triangles and rings, and the area, bounding box,
/// centroid and mean HU. For the asset it has the parameters, the area of each material over all
/// slices, the surfaces, and the grids on which the asset stores HU (one for the material, one for
/// the context). `bytes` is the size of the asset's file.
nlohmann::json describe_asset(const Asset& asset, std::uint64_t bytes);

}  // namespace trocar::pipeline
