// SPDX-License-Identifier: GPL-3.0-or-later
// Opens any input as a stack of slices: chooses the reader for files or a folder.
// Tests: tests/pipeline/read/readers_test.cpp
#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Opens a list of files, or the scan that search_folder() finds in one folder. Warnings:
/// other_input if other scans in the folder are left out; those of the readers. Errors: kRefused if
/// an input does not exist, a file is broken, nothing is usable, sizes differ, or an axis is given
/// for DICOM slices that do not form a regular volume. kUsage if the spacing is missing, an axis is
/// given for images, a series is given for input that is not DICOM or does not have this series, or
/// the folder contains several volumes or folders of images.
Result<std::unique_ptr<SliceStack>> open_stack(const std::vector<std::filesystem::path>& inputs,
                                               const OpenOptions& options);

/// Can the file be part of a scan, so that it must not be overwritten? A file can if its name is
/// that of an image or a NIfTI file, or if its first bytes are those of a DICOM file.
bool is_scan_file(const std::filesystem::path& file);

}  // namespace trocar::pipeline
