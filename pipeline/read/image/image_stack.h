// SPDX-License-Identifier: GPL-3.0-or-later
// Opens image files as a stack of slices.
// Tests: tests/pipeline/read/readers_test.cpp
#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// The stack has one slice for each file, in the order of `files`, with the distances of
/// options.spacing_mm. Errors: (usage) the spacing is missing; (refused) those of
/// read_image_file(); images have different sizes.
Result<std::unique_ptr<SliceStack>> open_images(std::vector<std::filesystem::path> files,
                                                const OpenOptions& options);

}  // namespace trocar::pipeline
