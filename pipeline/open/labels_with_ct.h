// SPDX-License-Identifier: GPL-3.0-or-later
// A label map and the CT from which it was made, on the same grid of voxels.
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

/// Opens both along options.axis. The other options apply to the label map only. A DICOM
/// segmentation gets the slices of the CT (OpenOptions::segmented_ct). The CT's warnings are added
/// to those of the label map. Errors: those of open_stack(); (refused) the CT's values are not HU,
/// or its grid differs from that of the label map (same_grid.h). Nothing is resampled.
Result<LabelsWithCt> open_labels_with_ct(const std::vector<std::filesystem::path>& inputs,
                                         const std::filesystem::path& ct,
                                         const OpenOptions& options);

}  // namespace trocar::pipeline
