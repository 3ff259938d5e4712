// SPDX-License-Identifier: GPL-3.0-or-later
// The surfaces for display that an asset stores (--surface).
#pragma once

#include <nlohmann/json.hpp>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/base/result.h"
#include "pipeline/segment/slice_field.h"
#include "pipeline/surface/display_surface.h"

namespace trocar::pipeline {

/// Makes the surface of each material from the slices `first` to `last`, both included. Adds the
/// surfaces to `asset` and warnings about them to `warnings`. Returns the entry `surface` of the
/// report. `materials` has the segmentation of each material of the asset, in the same order; the
/// function uses these segmentations instead of options.segmentation. Errors: those of
/// read_surface_volume() and make_display_surface(); kRefused if the asset has only one material
/// and none of its components is large enough.
Result<nlohmann::json> add_surfaces(const SliceStack& stack, int first, int last,
                                    const MaterialOptions& options, const SurfaceOptions& wanted,
                                    const std::vector<Segmentation>& materials, Asset& asset,
                                    nlohmann::json& warnings);

}  // namespace trocar::pipeline
