// SPDX-License-Identifier: GPL-3.0-or-later
// NRRD: headers, and volumes as stacks of slices.
#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/nifti.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Opens a NIfTI or NRRD file, whichever its name says, and sets SliceStack::files. Precondition:
/// is_volume(file).
Result<std::unique_ptr<SliceStack>> open_volume(const std::filesystem::path& file,
                                                const OpenOptions& options,
                                                bool header_only = false);

/// The files of a volume: the file itself and, if its data are in another file, that one.
std::vector<std::filesystem::path> files_of_volume(const std::filesystem::path& file);

}  // namespace trocar::pipeline
