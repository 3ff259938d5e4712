// SPDX-License-Identifier: GPL-3.0-or-later
// Opens a DICOM segmentation (SEG) as a label map.
#pragma once

#include <memory>

#include "formats/base/result.h"
#include "pipeline/read/dicom/dicom_headers.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Opens a segmentation as a stack whose values are segment numbers, and 0 outside all segments. If
/// options.segmented_ct is set, the stack has the slices of that CT. Otherwise it extends along the
/// normal from the lowest frame to the highest. A slice without a frame is empty. Preconditions:
/// `file` comes from read_dicom_headers(), and its kind is kSegmentation.
///
/// Errors: kRefused if the frames contradict each other, or if a frame lies on no slice of
/// options.segmented_ct; those of resliced(). SliceStack::read() refuses a slice in which two
/// wanted segments (options.labels) overlap. Warnings: frames_left_out, uneven_spacing.
Result<std::unique_ptr<SliceStack>> open_segmentation(const DicomFile& file,
                                                      const OpenOptions& options);

}  // namespace trocar::pipeline
