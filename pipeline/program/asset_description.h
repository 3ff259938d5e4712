// SPDX-License-Identifier: GPL-3.0-or-later
// Describes an asset, for `trocar-mesh info`.
// Tests: tests/e2e/info_test.py
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>

#include "formats/asset/asset.h"

namespace trocar::pipeline {

/// Counts, planes, areas, boxes, centroids, mean HU and parameters of an asset, slice by slice, and
/// the area of each material summed over the slices (formats/session/info.schema.json). `bytes` is
/// the size of the asset's file.
nlohmann::json describe_asset(const Asset& asset, std::uint64_t bytes);

}  // namespace trocar::pipeline
