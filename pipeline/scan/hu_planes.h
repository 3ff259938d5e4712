// SPDX-License-Identifier: GPL-3.0-or-later
// The HU of slices for the asset (formats/asset/hu_volume.h). If the scan's pixels are about 1 mm
// or coarser, every pixel is used, otherwise every second, third, ... pixel.
// Tests: tests/pipeline/scan/hu_planes_test.cpp, tests/e2e/hu_volume_test.py
#pragma once

#include <vector>

#include "formats/asset/asset.h"
#include "formats/asset/hu_codec.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/scan/mesh_slice.h"

namespace trocar::pipeline {

/// The positions of samples in an image: sample (i, j) is at pixel (i * columns_each, j *
/// rows_each). The last column and the last row may lie outside the image.
struct HuSampling {
  HuGrid grid;
  int columns_each = 1, rows_each = 1;
};

/// The sampling of the (cropped) slices of a stack. For pixels of up to 1.15 mm the pitch of the
/// samples is between 0.57 and 1.15 mm; coarser pixels are all samples. Samples within the margin
/// around the material are stored, so that means over a needle's cross-section are possible at the
/// border of bone. The margin is 1.5 mm, or one pitch if that is larger. Stored HU are multiples of
/// a step. The step is 72 HU at a pitch of 1 mm and inversely proportional to the pitch, from 8 to
/// 96 HU. The rounding errors of a mean over 3 mm are then 2 to 5 HU, whatever the pitch.
HuSampling hu_sampling(const SlicePlane& plane, int width, int height, const MeshOptions& options);

/// The samples of an image of HU inside the box, row by row. Between samples HU are bilinear. If
/// the samples are coarser than the pixels, they are the least-squares fit to the pixels in and
/// around the box.
std::vector<float> hu_samples(const Image& hu, const HuSampling& sampling, const HuMask& box);

/// The encoded plane of a slice; it has no bytes if it is empty. Errors: those of hu_mask().
Result<EncodedHuPlane> encode_hu(int index, const Image& hu, const HuSampling& sampling,
                                 const Lattice& lattice, Outlines outlines);

}  // namespace trocar::pipeline
