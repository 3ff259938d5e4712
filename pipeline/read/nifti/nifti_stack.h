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
/// (usage) the file states no voxel size and options.spacing_mm is missing. Warnings: no_modality,
/// spacing_ignored.
Result<std::unique_ptr<SliceStack>> open_nifti(const std::filesystem::path& file,
                                               const OpenOptions& options);

/// The same without the voxels: read() then returns an error.
Result<std::unique_ptr<SliceStack>> open_nifti_header(const std::filesystem::path& file,
                                                      const OpenOptions& options);

/// The slices along an axis. `voxels` has the voxels, which `header` describes. `name` is used in
/// messages. Errors (refused): rows and columns of the planes are not at right angles, or the
/// planes are too large.
Result<std::unique_ptr<SliceStack>> open_voxels(const std::string& name, const NiftiHeader& header,
                                                VolumeFile voxels, SliceAxis axis);

}  // namespace trocar::pipeline
