// SPDX-License-Identifier: GPL-3.0-or-later
// A small picture of an asset: its middle slice with its mesh.
#pragma once

#include <optional>

#include "formats/asset/asset.h"
#include "pipeline/preview/preview_sheet.h"

namespace trocar::pipeline {

/// The AssetSlice::index of the middle one of the slices with triangles; std::nullopt if there is
/// no such slice.
std::optional<int> middle_slice(const Asset& asset);

struct Thumbnail {
  Picture picture;
  double width_mm = 0, height_mm = 0;  ///< size of the material's bounding box in the slice
};

/// Draws the slice whose AssetSlice::index is `slice` into a square of size_px x size_px pixels.
/// The picture shows the triangles, their edges, and the outline. Materials have different colours,
/// which repeat after six. If the asset has HU, a triangle with higher HU at its centroid is
/// brighter. Precondition: the slice has triangles.
Thumbnail draw_thumbnail(const Asset& asset, int slice, int size_px);

}  // namespace trocar::pipeline
