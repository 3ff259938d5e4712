// SPDX-License-Identifier: GPL-3.0-or-later
// The field of one slice of a scan: its pixels within a crop, after segmentation. If wanted, the
// scanner's table is removed, and SolidBone adds and removes pixels.
#pragma once

#include <optional>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/segment/scanner_table.h"
#include "pipeline/segment/segmentation.h"
#include "pipeline/segment/solid_bone.h"

namespace trocar::pipeline {

struct Crop {
  int x0 = 0, x1 = 0, y0 = 0, y1 = 0;  ///< first and last column and row, both included
};

/// The choice of material in a scan.
struct MaterialOptions {
  Segmentation segmentation = Threshold{};
  std::optional<Crop> crop;
  const SolidBone* solid = nullptr;     ///< if not null, the voxels of `solid` are the material
  const ScannerTable* table = nullptr;  ///< table to remove, or null; `solid` must not contain it
  double min_region_mm2 = 1;  ///< islands below this area are dropped, holes below it are filled
};

/// Reads the values of a slice and, if `crop` has a value, crops them. Errors: those of
/// stack.read().
Result<Image> read_cropped(const SliceStack& stack, int slice, const std::optional<Crop>& crop);
/// The same for the pixels that the segmentation of `options` needs. Errors: those of
/// read_pixels().
Result<Pixels> read_cropped(const SliceStack& stack, int slice, const MaterialOptions& options);

struct SliceField {
  Field field;
  std::optional<double> solid_mean;  ///< result of SolidBone::apply(); no value without `solid`
};

/// The field of a slice. Precondition: `pixels` are the result of read_cropped() for this slice.
SliceField slice_field(const SliceStack& stack, int slice, const MaterialOptions& options,
                       Pixels pixels);

}  // namespace trocar::pipeline
