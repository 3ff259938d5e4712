// SPDX-License-Identifier: GPL-3.0-or-later
// A stack of slices along another axis of its volume.
// Tests: tests/pipeline/read/readers_test.cpp
#pragma once

#include <memory>
#include <string>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// The volume of a stack, sliced along an axis as a NIfTI volume is. Its voxels are written to a
/// temporary file. `where` names the input in messages. Errors (refused): the slices are tilted,
/// not evenly spaced, or a single one.
Result<std::unique_ptr<SliceStack>> resliced(std::unique_ptr<SliceStack> stack, SliceAxis axis,
                                             const std::string& where);

}  // namespace trocar::pipeline
