// SPDX-License-Identifier: GPL-3.0-or-later
// Samples and compresses the HU of slices for the asset (formats/asset/hu_codec.h). If pixels are
// wider than about 0.57 mm, every pixel is a sample. If they are narrower, every second, third, ...
// pixel is a sample, so that samples are between 0.7 and 1.15 mm apart.
#pragma once

#include <cstdint>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/asset/hu_codec.h"
#include "pipeline/bake/mesh_slice.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// The positions of samples in an image: sample (i, j) is at pixel (i * columns_each, j *
/// rows_each). The last column and the last row of samples may lie outside the image.
struct HuSampling {
  HuGrid grid;
  int columns_each = 1, rows_each = 1;
};

/// Chooses the sampling for slices of `width` x `height` pixels, which are already cropped. The
/// pitch is the distance between samples. If pixels are at most 1.15 mm wide, the pitch is between
/// 0.57 and 1.15 mm. If they are wider, every pixel is a sample.
///
/// The asset stores the samples in the material and in a margin around it. Thanks to the margin,
/// the mean HU over a needle's cross-section can also be computed at the border of bone. The margin
/// is 1.5 mm, or one pitch if that is larger.
///
/// Stored HU are multiples of a step. The step in HU is about 72 divided by the pitch in mm, but at
/// least 8 and at most 96. With this step, the rounding error of the mean over a needle's
/// cross-section (3 mm wide) is 2 to 5 HU, whatever the pitch.
///
/// `coarser` multiplies the pitch, as long as two samples are left along each side.
HuSampling hu_sampling(const SlicePlane& plane, int width, int height, const MeshOptions& options,
                       int coarser = 1);

/// Computes the samples in a rectangle, row by row. `box` has the rectangle's first column, first
/// row and size, in samples. If every pixel is a sample, the result has the values of the pixels.
/// Otherwise the samples are a least-squares fit: their bilinear interpolation approximates the
/// pixels in and around the box.
std::vector<float> hu_samples(const Image& hu, const HuSampling& sampling, const HuMask& box);

struct EncodedHu : EncodedHuPlane {
  std::int64_t samples = 0;  ///< in the plane's box (max_hu_samples())
};

/// Encodes the plane of the slice `index`. The plane has no bytes if no sample is stored. Errors:
/// those of hu_mask().
Result<EncodedHu> encode_hu(int index, const Image& hu, const HuSampling& sampling,
                            const Lattice& lattice, Outlines outlines);

// The HU of a whole scan, not only of the material, on a coarse grid for X-ray pictures
// (--context). If the scan shows the head, these HU can show the patient's face, so an asset that
// contains them is not anonymous. The pitch is the spacing of the grid.

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
