// SPDX-License-Identifier: GPL-3.0-or-later
// The HU of everything in a scan on a coarse grid (--context), for X-ray pictures. It can show a face.
// Tests: tests/e2e/hu_volume_test.py
#pragma once

#include "formats/asset/asset.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/scan/mesh_slice.h"

namespace trocar::pipeline {

/// The pitch if none is given: 2 mm for slices up to 128 mm wide and high, 3 mm up to 256 mm, else 4 mm.
double default_context_mm(const SlicePlane& plane, int width, int height);

/// Planes of slices `first` to `last` of a stack of HU, of samples. Planes, and samples in a plane, are at most `pitch_mm` apart
/// where the scan's own are, and 5 % more at most: edges of bone need that to be seen in an X-ray picture. A sample
/// is the mean over a block of pixels and, weighted by a triangle, over the slices up to the planes above and below.
/// Crops by options.crop. The result does not depend on the number of threads. Errors: those of stack.read().
Result<EncodedHuVolume> encode_context(const SliceStack& stack, int first, int last,
                                       double pitch_mm, const MeshOptions& options);

}  // namespace trocar::pipeline
