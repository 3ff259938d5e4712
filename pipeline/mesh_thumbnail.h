// SPDX-License-Identifier: GPL-3.0-or-later
// A small picture of an asset: its middle slice with its mesh.
#pragma once

#include <optional>

#include "formats/asset/asset.h"
#include "pipeline/preview_sheet.h"

namespace trocar::pipeline {

/// AssetSlice::index of the middle one of the slices that have triangles; nothing if none has.
std::optional<int> middle_slice(const Asset& asset);

struct Thumbnail {
  Picture picture;
  double width_mm = 0, height_mm = 0;  ///< of the material in the slice
};

/// A square of `size_px` with all material of the slice, which must be there: its triangles, grey
/// by their HU where the asset has them, the edges between them and the outline. Materials have
/// colours of their own.
Thumbnail draw_thumbnail(const Asset& asset, int slice, int size_px);

}  // namespace trocar::pipeline
