// SPDX-License-Identifier: GPL-3.0-or-later
// A NIfTI volume as a stack of slices along one of its axes.
// Tests: tests/pipeline/read/nifti/nifti_orientation_test.py
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "formats/base/result.h"
#include "pipeline/read/nifti/nifti_header.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/read/volume_file.h"

namespace trocar::pipeline {

/// Errors: those of parse_nifti_header(), VolumeFile::open() and open_voxels(); (usage) the file
/// states no voxel size and options.spacing_mm is missing. Warnings: no_modality, spacing_ignored.
Result<std::unique_ptr<SliceStack>> open_nifti(const std::filesystem::path& file,
                                               const OpenOptions& options);

/// The same without its voxels: read() is refused.
Result<std::unique_ptr<SliceStack>> open_nifti_header(const std::filesystem::path& file,
                                                      const OpenOptions& options);

/// The slices along an axis of voxels on disk that this header describes. `name` is used in
/// messages. Errors (refused): the planes' rows and columns are not at right angles, or too large.
Result<std::unique_ptr<SliceStack>> open_voxels(const std::string& name, const NiftiHeader& header,
                                                VolumeFile voxels, SliceAxis axis);

}  // namespace trocar::pipeline
