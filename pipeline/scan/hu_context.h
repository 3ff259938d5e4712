// SPDX-License-Identifier: GPL-3.0-or-later
// The HU of a whole scan, not only of the material, on a coarse grid for X-ray pictures
// (--context). If the scan shows the head, these HU can show the patient's face, so an asset that
// contains them is not anonymous. The pitch is the spacing of the grid.
#pragma once

#include "formats/asset/asset.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/scan/mesh_slice.h"

namespace trocar::pipeline {

/// The default pitch: 2 mm if the longer side of the image is at most 128 mm, 3 mm if it is at most
/// 256 mm, otherwise 4 mm.
double default_context_mm(const SlicePlane& plane, int width, int height);

/// Encodes the HU of the slices `first` to `last`, both included, cropped by options.crop.
///
/// Along each axis the pitch is n times the spacing of the scan. The number n is the largest one
/// for which the pitch is at most 1.05 * pitch_mm, but at least 1. (A coarser grid would lose edges
/// of bone in an X-ray picture.) Exception: if a plane would have more than 4096 samples along a
/// side, n is larger.
///
/// The value of a sample is a mean over a block of pixels and over the slices near the sample's
/// plane. The weight of a slice decreases linearly with its distance from this plane, and is zero
/// at the next plane of the grid on either side. If there is no next plane on one side, the weight
/// decreases there as on the other side. Distances are in mm; if slices are evenly spaced within
/// 1 %, they are counted in slices. The result does not depend on the number of threads. Errors:
/// those of stack.read().
Result<EncodedHuVolume> encode_context(const SliceStack& stack, int first, int last,
                                       double pitch_mm, const MeshOptions& options);

}  // namespace trocar::pipeline
