// SPDX-License-Identifier: GPL-3.0-or-later
// A small picture of an asset: its middle slice with its mesh.
// Tests: tests/e2e/review_test.py
#pragma once

#include <optional>

#include "formats/asset/asset.h"
#include "pipeline/preview/preview_sheet.h"

namespace trocar::pipeline {

/// AssetSlice::index of the middle one of the slices with triangles; std::nullopt if there is no
/// such slice.
std::optional<int> middle_slice(const Asset& asset);

struct Thumbnail {
  Picture picture;
  double width_mm = 0, height_mm = 0;  ///< size of the material in the slice
};

/// Draws a slice into a square of `size_px`: its triangles (with brightness by HU if the asset has
/// HU), the edges between them, and the outline. Each material has its own colour. Precondition:
/// the slice has triangles.
Thumbnail draw_thumbnail(const Asset& asset, int slice, int size_px);

}  // namespace trocar::pipeline
