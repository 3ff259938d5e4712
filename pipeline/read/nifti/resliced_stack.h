// SPDX-License-Identifier: GPL-3.0-or-later
// Slices a stack along another axis of its volume.
// Tests: tests/pipeline/read/readers_test.cpp
#pragma once

#include <memory>
#include <string>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Slices the volume of a stack along `axis`, in the same way as a NIfTI volume. The voxels are
/// written to a temporary file. `where` names the input in messages. Errors: kRefused if the slices
/// are tilted or not evenly spaced, or if there is only one.
Result<std::unique_ptr<SliceStack>> resliced(std::unique_ptr<SliceStack> stack, SliceAxis axis,
                                             const std::string& where);

}  // namespace trocar::pipeline
