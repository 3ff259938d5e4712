// SPDX-License-Identifier: GPL-3.0-or-later
// The HU of everything in a scan on a coarse grid (--context), for X-ray pictures. Such a volume of
// a head can show a face. The pitch is the spacing of the grid.
// Tests: tests/e2e/hu_volume_test.py
#pragma once

#include "formats/asset/asset.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/scan/mesh_slice.h"

namespace trocar::pipeline {

/// The pitch if none is given: 2 mm if slices are at most 128 mm wide and high, 3 mm up to 256 mm,
/// otherwise 4 mm.
double default_context_mm(const SlicePlane& plane, int width, int height);

/// Encodes the HU of slices `first` to `last` on a coarse grid. Along each axis the pitch is a
/// multiple of the spacing of the scan. It is the largest multiple up to 1.05 * pitch_mm, but at
/// least the spacing of the scan. (A coarser grid would lose edges of bone in an X-ray picture.)
/// Only planes that would have more than 4096 samples a side are coarser than that. A sample is the
/// mean over a block of pixels and over the neighbouring slices, with weights that fall to zero at
/// the next planes of the grid. The image is cropped by options.crop. The result does not depend on
/// the number of threads. Errors: those of stack.read().
Result<EncodedHuVolume> encode_context(const SliceStack& stack, int first, int last,
                                       double pitch_mm, const MeshOptions& options);

}  // namespace trocar::pipeline
