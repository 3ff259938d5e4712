// SPDX-License-Identifier: GPL-3.0-or-later
// A DICOM segmentation (SEG) as a label map.
// Tests: tests/pipeline/read/dicom/dicom_segmentation_test.py, tests/pipeline/read/dicom/dicom_segmentation_peer_test.cpp
#pragma once

#include <memory>

#include "formats/base/result.h"
#include "pipeline/read/dicom/dicom_headers.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Opens a segmentation. Its labels are the numbers of the segments. Precondition: `file` comes
/// from read_dicom_headers(). Slices without a frame are empty. Errors: kRefused if the frames do
/// not fit each other or options.segmented_ct; those of resliced(). SliceStack::read() refuses a
/// slice in which wanted segments overlap. Warnings: frames_left_out, uneven_spacing.
Result<std::unique_ptr<SliceStack>> open_segmentation(const DicomFile& file,
                                                      const OpenOptions& options);

}  // namespace trocar::pipeline
