// SPDX-License-Identifier: GPL-3.0-or-later
// Opens a NIfTI volume as a stack of slices along one of its axes.
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

/// Opens the file. Errors: those of parse_nifti_header(), VolumeFile::open() and open_voxels();
/// kUsage if the file states no voxel size and options.spacing_mm is missing. Warnings: those of
/// parse_nifti_header(), no_modality, spacing_ignored.
Result<std::unique_ptr<SliceStack>> open_nifti(const std::filesystem::path& file,
                                               const OpenOptions& options);

/// The same as open_nifti(), but without the voxels: read() of the stack then returns an error.
Result<std::unique_ptr<SliceStack>> open_nifti_header(const std::filesystem::path& file,
                                                      const OpenOptions& options);

/// Makes a stack of the slices along `axis`. `header` describes the array and `voxels` has its
/// values. `name` is used in messages. Errors: kRefused if the axes span no volume, rows and
/// columns of the planes are not at right angles, or the planes are too small or too large.
Result<std::unique_ptr<SliceStack>> open_voxels(const std::string& name, const NiftiHeader& header,
                                                VolumeFile voxels, SliceAxis axis);

}  // namespace trocar::pipeline
