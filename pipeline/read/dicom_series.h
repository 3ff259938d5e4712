// SPDX-License-Identifier: GPL-3.0-or-later
// Which of a folder's DICOM images are the scan, and in which order.
#pragma once

#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/dicom_headers.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// The slices of one series: the one with `wanted` as its UID, or, if that is empty, the one with
/// most images, naming the others in `warnings`. Images without a series UID are grouped by frame
/// of reference, orientation and size. Localisers and files that are not images are left out, with
/// a warning. Errors: (refused) a file of the chosen series cannot be used, or lacks a rescale that
/// others have; no images; (usage) no such series.
Result<std::vector<DicomFrame>> choose_series(const std::vector<DicomFile>& files,
                                              const std::string& wanted, const std::string& where,
                                              std::vector<Warning>& warnings);

/// Sorts by position along the first one's normal (ascending). Errors (refused): size, orientation,
/// pixel spacing or frame of reference differ, or two at the same position: both files are named.
/// Warnings: missing_slice, uneven_spacing, gantry_tilt.
Result<void> sort_and_check(std::vector<DicomFrame>& slices, std::vector<Warning>& warnings);

}  // namespace trocar::pipeline
