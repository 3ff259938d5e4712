// SPDX-License-Identifier: GPL-3.0-or-later
// Opens a label map together with the CT from which it was made. Both must have the same
// grid of voxels.
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

/// Opens the label map `inputs` and the CT `ct`. options.axis applies to both, the other options
/// only to the label map. The file of a DICOM segmentation may leave out slices without labels.
/// Such slices are added as empty ones, so that the label map has the same slices as the CT
/// (OpenOptions::segmented_ct). The CT's warnings are added to those of the label map. Nothing is
/// resampled. Errors: those of open_stack(); kRefused if the CT's values are not HU, or if its grid
/// differs from the label map's grid (same_grid.h).
Result<LabelsWithCt> open_labels_with_ct(const std::vector<std::filesystem::path>& inputs,
                                         const std::filesystem::path& ct,
                                         const OpenOptions& options);

}  // namespace trocar::pipeline
