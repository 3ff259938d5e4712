// SPDX-License-Identifier: GPL-3.0-or-later
// The grid on which the vertices of all slices are encoded.
#pragma once

#include "formats/asset/asset.h"
#include "pipeline/scan/mesh_slice.h"

namespace trocar::pipeline {

/// Returns the grid to which Draco quantises the vertices of the slices `first` to `last`, both
/// included. It covers the image of these slices, or the crop of the image, and a margin. It
/// therefore contains every vertex. Errors: those of asset_grid().
Result<DracoGrid> encoding_grid(const SliceStack& stack, int first, int last,
                                const MeshOptions& options);

}  // namespace trocar::pipeline
