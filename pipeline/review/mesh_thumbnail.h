// SPDX-License-Identifier: GPL-3.0-or-later
// A small picture of an asset: its middle slice with its mesh.
// Tests: tests/e2e/review_test.py
#pragma once

#include <optional>

#include "formats/asset/asset.h"
#include "pipeline/preview/preview_sheet.h"

namespace trocar::pipeline {

/// AssetSlice::index of the middle slice of those that have triangles; std::nullopt if no slice has
/// any.
std::optional<int> middle_slice(const Asset& asset);

struct Thumbnail {
  Picture picture;
  double width_mm = 0, height_mm = 0;  ///< size of the material's bounding box in the slice
};

/// Draws the slice with AssetSlice::index `slice` into a square of size_px x size_px pixels: its
/// triangles, their edges, and the outline. Materials have different colours, which repeat after
/// six. If the asset has HU, triangles with higher HU are brighter. Precondition: the slice has
/// triangles.
Thumbnail draw_thumbnail(const Asset& asset, int slice, int size_px);

}  // namespace trocar::pipeline
