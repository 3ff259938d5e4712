// SPDX-License-Identifier: GPL-3.0-or-later
// A label map and the CT that it was made on, on the same grid of voxels.
#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

struct LabelsWithCt {
  std::unique_ptr<SliceStack> labels;
  std::unique_ptr<SliceStack> ct;  ///< in HU, on the grid of `labels`
};

/// Opens both along options.axis; the other options apply to the label map. A DICOM segmentation
/// gets the CT's slices (OpenOptions::segmented_ct). The CT's warnings are added to the label
/// map's. Errors: those of open_stack(); (refused) the CT's values are not HU, or its grid differs
/// (same_grid.h), since nothing is resampled.
Result<LabelsWithCt> open_labels_with_ct(const std::vector<std::filesystem::path>& inputs,
                                         const std::filesystem::path& ct,
                                         const OpenOptions& options);

}  // namespace trocar::pipeline
