// SPDX-License-Identifier: GPL-3.0-or-later
// Opens image files as a stack of slices.
#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Makes a stack with one slice for each file, in the order of `files`. options.spacing_mm gives
/// the pixel sizes and the slice distance. Only the first image is decoded here. Precondition:
/// `files` is not empty. Errors: kUsage if the spacing is missing; those of read_image_file().
/// SliceStack::read() refuses an image whose size differs from that of the first image. Warnings:
/// missing_slice if the numbers in the file names have a gap.
Result<std::unique_ptr<SliceStack>> open_images(std::vector<std::filesystem::path> files,
                                                const OpenOptions& options);

}  // namespace trocar::pipeline
