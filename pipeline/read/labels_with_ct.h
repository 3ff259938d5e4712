// SPDX-License-Identifier: GPL-3.0-or-later
// A label map and the CT that it was made on, pixel beside pixel.
#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

struct LabelsWithCt {
  std::unique_ptr<SliceStack> labels;
  std::unique_ptr<SliceStack> ct;  ///< in HU; as many slices and pixels, in the same places
};

/// Opens both along options.axis; the other options are the label map's. A DICOM segmentation gets
/// the CT's slices (OpenOptions::segmented_ct). The CT's warnings are added to the label map's.
/// Errors: those of open_stack(); (refused) the CT's values are not HU, or its grid is another one
/// (same_grid.h): nothing is resampled.
Result<LabelsWithCt> open_labels_with_ct(const std::vector<std::filesystem::path>& inputs,
                                         const std::filesystem::path& ct,
                                         const OpenOptions& options);

}  // namespace trocar::pipeline
