// SPDX-License-Identifier: GPL-3.0-or-later
// The surfaces for display that an asset stores (--surface).
// Tests: tests/e2e/surface_test.py
#pragma once

#include <nlohmann/json.hpp>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/base/result.h"
#include "pipeline/segment/slice_field.h"
#include "pipeline/surface/display_surface.h"

namespace trocar::pipeline {

/// Adds the surface of each material in the slices `first` to `last` to the asset, and the warnings
/// about these surfaces to `warnings`. Returns the report of the surfaces. `materials` gives the
/// segmentation of each of the asset's materials, in the order of the asset, and replaces
/// options.segmentation. Errors: those of read_surface_volume() and make_display_surface();
/// kRefused if the asset has only one material and none of its components is large enough.
Result<nlohmann::json> add_surfaces(const SliceStack& stack, int first, int last,
                                    const MaterialOptions& options, const SurfaceOptions& wanted,
                                    const std::vector<Segmentation>& materials, Asset& asset,
                                    nlohmann::json& warnings);

}  // namespace trocar::pipeline
