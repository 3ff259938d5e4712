// SPDX-License-Identifier: GPL-3.0-or-later
// DICOM files as a stack of slices: one series, or a segmentation for labels.
// Tests: tests/pipeline/read/readers_test.cpp
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/dicom/dicom_headers.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Takes the series of options.series, else the one that choose_series() prefers; with
/// options.as_labels a segmentation if there is one. Errors (refused): no usable slice, those of
/// the series (dicom_series.h), of open_segmentation() and of resliced(). `where` names the input
/// in messages.
Result<std::unique_ptr<SliceStack>> open_dicom(std::vector<DicomFile> headers,
                                               const std::string& where,
                                               const OpenOptions& options);

/// Reads the headers of the files first.
Result<std::unique_ptr<SliceStack>> open_dicom(const std::vector<std::filesystem::path>& files,
                                               const OpenOptions& options);

}  // namespace trocar::pipeline
