// SPDX-License-Identifier: GPL-3.0-or-later
// The surfaces for display of an asset (--surface).
#pragma once

#include <vector>

#include "pipeline/batch.h"

namespace trocar::pipeline {

/// Adds the surface of each material in the slices first .. last to the asset, and what is to be
/// said of them to `warnings`; gives their part of the report. `materials` says what each of the
/// asset's materials is in the scan. Errors: those of read_surface_volume() and
/// make_display_surface(); (refused) no piece of the only material is large enough.
Result<nlohmann::json> add_surfaces(const SliceStack& stack, int first, int last,
                                    const BatchOptions& options,
                                    const std::vector<Segmentation>& materials, Asset& asset,
                                    nlohmann::json& warnings);

}  // namespace trocar::pipeline
