// SPDX-License-Identifier: GPL-3.0-or-later
// Opens a NRRD volume as a stack of slices along one of its axes.
#pragma once

#include <filesystem>
#include <memory>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// As open_nifti(), for a NRRD file with its data, or a header whose data are in another file of
/// the same folder. Errors: those of parse_nrrd_header(), VolumeFile::open_part() and open_array().
/// Warnings: those of parse_nrrd_header() and open_array().
Result<std::unique_ptr<SliceStack>> open_nrrd(const std::filesystem::path& file,
                                              const OpenOptions& options, bool header_only = false);

/// Opens a NIfTI or NRRD file, whichever its name says, and sets SliceStack::files. Precondition:
/// is_volume(file).
Result<std::unique_ptr<SliceStack>> open_volume(const std::filesystem::path& file,
                                                const OpenOptions& options,
                                                bool header_only = false);

/// The files of a volume: the file itself and, if its data are in another file, that one.
std::vector<std::filesystem::path> files_of_volume(const std::filesystem::path& file);

}  // namespace trocar::pipeline
