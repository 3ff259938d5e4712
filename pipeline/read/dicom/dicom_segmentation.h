// SPDX-License-Identifier: GPL-3.0-or-later
// A DICOM segmentation (SEG) as a label map.
// Tests: tests/pipeline/read/dicom/dicom_segmentation_test.py, tests/pipeline/read/dicom/dicom_segmentation_peer_test.cpp
#pragma once

#include <memory>

#include "formats/base/result.h"
#include "pipeline/read/dicom/dicom_headers.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Opens a segmentation. Its labels are the numbers of the segments. `file` must come from
/// read_dicom_headers(). Slices without a frame are empty. Errors (refused): frames do not fit each
/// other or options.segmented_ct; when a slice is read, wanted segments overlap. Warnings:
/// frames_left_out, uneven_spacing.
Result<std::unique_ptr<SliceStack>> open_segmentation(const DicomFile& file,
                                                      const OpenOptions& options);

}  // namespace trocar::pipeline
