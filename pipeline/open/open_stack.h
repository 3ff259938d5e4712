// SPDX-License-Identifier: GPL-3.0-or-later
// Opens any input as a stack of slices: chooses the reader for files or a folder.
#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Opens a list of files, or the scan that search_folder() finds in one folder. Warnings:
/// those of the readers, and other_input if other scans in the folder are left out.
///
/// Errors: kRefused if an input does not exist, a file is broken, no file is usable, slices differ
/// in size, or an axis (option --axis) is given for DICOM slices that do not form a regular volume.
/// kUsage if the inputs and the options do not fit together, for example:
///  - No spacing is given for images, or for a NIfTI or NRRD file that states none.
///  - Images are given with an axis other than axial.
///  - The index of a volume (OpenOptions::volume) is given for input with one volume that is neither
///    NIfTI nor NRRD, or missing for input with several.
///  - A series is given for input that is not DICOM, or the input does not have the series.
///  - The folder contains several files of volumes, or several folders of images.
///  - A folder or a file of volumes is given together with other inputs.
Result<std::unique_ptr<SliceStack>> open_stack(const std::vector<std::filesystem::path>& inputs,
                                               const OpenOptions& options);

/// True if the file may be part of a scan, so that a program must not overwrite it. Such a file has
/// the name of an image, a NIfTI or a NRRD file, or it begins like a DICOM file (has_dicom_preamble()).
bool is_scan_file(const std::filesystem::path& file);

// Opens a label map together with the CT from which it was made. Both must have the same
// grid of voxels.

struct LabelsWithCt {
  std::unique_ptr<SliceStack> labels;
  std::unique_ptr<SliceStack> ct;  ///< in HU, on the grid of `labels`
};

/// Opens the label map `inputs` and the CT `ct`. options.axis applies to both, the other options
/// only to the label map. The file of a DICOM segmentation may leave out slices without labels.
/// Such slices are added as empty ones, so that the label map has the same slices as the CT
/// (OpenOptions::segmented_ct). The CT's warnings are added to those of the label map. Nothing is
/// resampled. Errors: those of open_stack(); kRefused if the CT's values are not HU, or if its grid
/// differs from the label map's grid (grid_difference()).
Result<LabelsWithCt> open_labels_with_ct(const std::vector<std::filesystem::path>& inputs,
                                         const std::filesystem::path& ct,
                                         const OpenOptions& options);

}  // namespace trocar::pipeline
