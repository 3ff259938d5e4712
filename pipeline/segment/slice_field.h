// SPDX-License-Identifier: GPL-3.0-or-later
// The field of one slice of a scan: its pixels within a crop, after segmentation. SolidBone adds
// and removes voxels, and a scanner's table is removed.
// Tests: tests/pipeline/scan/materials_test.cpp
#pragma once

#include <optional>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/segment/scanner_table.h"
#include "pipeline/segment/segmentation.h"
#include "pipeline/segment/solid_bone.h"

namespace trocar::pipeline {

struct Crop {
  int x0 = 0, x1 = 0, y0 = 0, y1 = 0;  ///< pixels, both ends included
};

/// The choice of material in a scan.
struct MaterialOptions {
  Segmentation segmentation = Threshold{};
  std::optional<Crop> crop;
  const SolidBone* solid = nullptr;  ///< the voxels that are material, if it overrides segmentation
  const ScannerTable* table = nullptr;  ///< left out; `solid` is then made without it
  double min_region_mm2 = 1;            ///< smaller islands are dropped, smaller holes filled
};

/// The slice's values within the crop, if there is one. Errors: those of stack.read().
Result<Image> read_cropped(const SliceStack& stack, int slice, const std::optional<Crop>& crop);

struct SliceField {
  Field field;
  std::optional<double> solid_mean;  ///< result of SolidBone::apply()
};

/// `image` is a result of read_cropped().
SliceField slice_field(const SliceStack& stack, int slice, const MaterialOptions& options,
                       Image image);

}  // namespace trocar::pipeline
