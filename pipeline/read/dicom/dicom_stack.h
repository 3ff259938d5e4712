// SPDX-License-Identifier: GPL-3.0-or-later
// Opens DICOM files as a stack of slices: one series or, if labels are wanted, a segmentation.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/dicom/dicom_headers.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Opens the series that options.series names or, if options.series is empty, the one that
/// choose_series() prefers. Exception: if options.as_labels is set and the input has a
/// segmentation, the segmentation is opened. If options.series is not empty, only segmentations in
/// that series count. `headers` are results of read_dicom_headers(). `where` names the input in
/// messages. Errors: kRefused if there is no usable slice; kUsage if there are several
/// segmentations; those of dicom_series.h, open_segmentation() and resliced().
Result<std::unique_ptr<SliceStack>> open_dicom(std::vector<DicomFile> headers,
                                               const std::string& where,
                                               const OpenOptions& options);

/// Reads the headers of `files` and opens them as above. Precondition: `files` is not empty.
Result<std::unique_ptr<SliceStack>> open_dicom(const std::vector<std::filesystem::path>& files,
                                               const OpenOptions& options);

// Opens a DICOM segmentation (SEG) as a label map.

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
