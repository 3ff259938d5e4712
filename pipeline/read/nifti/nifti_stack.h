// SPDX-License-Identifier: GPL-3.0-or-later
// Opens a NIfTI volume as a stack of slices along one of its axes.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/nifti/nifti_header.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/read/volume_file.h"

namespace trocar::pipeline {

/// Opens the file with slices along options.axis, or with axial slices if that is not set. With
/// `header_only`, reads the header only, for example to list the file; read() of the stack returns
/// an error. Errors: those of parse_nifti_header(), VolumeFile::open() and open_array(). Warnings:
/// those of parse_nifti_header() and open_array().
Result<std::unique_ptr<SliceStack>> open_nifti(const std::filesystem::path& file,
                                               const OpenOptions& options,
                                               bool header_only = false);

/// The stack of an array that a file of volumes holds, along options.axis or, if that is not set,
/// with axial slices. `open` opens the voxels; empty: read() of the stack returns an error.
/// Errors: those of `open` and of open_voxels(); kUsage if the header states no voxel size and
/// options.spacing_mm is missing. Warnings: `warnings`, no_modality, spacing_ignored.
Result<std::unique_ptr<SliceStack>> open_array(const std::string& file, NiftiHeader header,
                                               const OpenOptions& options,
                                               std::vector<Warning> warnings,
                                               const std::function<Result<VolumeFile>()>& open);

/// Makes a stack with slices along `axis` from an array of voxels: `header` describes the array,
/// and `voxels` has its values. Slices are stacked along the array axis that is nearest to `axis`.
/// `name` is the input's name in error messages. Errors: kRefused if the axes of the array span no
/// volume, if rows and columns of a slice are not at right angles, or if a slice is too small or
/// too large.
Result<std::unique_ptr<SliceStack>> open_voxels(const std::string& name, const NiftiHeader& header,
                                                VolumeFile voxels, SliceAxis axis);

}  // namespace trocar::pipeline
