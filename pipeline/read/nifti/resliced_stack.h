// SPDX-License-Identifier: GPL-3.0-or-later
// Slices a stack along another axis of its volume.
#pragma once

#include <memory>
#include <string>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Reads all slices of a stack, writes the voxels to a temporary file, and returns a stack of these
/// voxels with slices along `axis` (open_voxels()). With `as_labels`, the voxels are those of
/// SliceStack::read_labels(). `where` names the input in messages. Errors:
/// kRefused if the slices are tilted or not evenly spaced, if there is only one slice, or if there
/// is no space for the temporary file; those of SliceStack::read() and open_voxels().
Result<std::unique_ptr<SliceStack>> resliced(std::unique_ptr<SliceStack> stack, SliceAxis axis,
                                             const std::string& where, bool as_labels);

}  // namespace trocar::pipeline
