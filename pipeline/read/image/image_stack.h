// SPDX-License-Identifier: GPL-3.0-or-later
// Image files as a stack of slices.
// Tests: tests/pipeline/read/readers_test.cpp
#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// One slice for each file, in their order, options.spacing_mm apart. Errors: (usage) no spacing;
/// (refused) those of read_image_file(); images of different sizes.
Result<std::unique_ptr<SliceStack>> open_images(std::vector<std::filesystem::path> files,
                                                const OpenOptions& options);

}  // namespace trocar::pipeline
