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

/// Opens a list of files, or the scan that search_folder() finds in one folder. Errors: (refused)
/// nothing is usable, sizes differ, a file is broken, or an axis is given for DICOM slices that do
/// not form a regular volume; (usage) the spacing is missing, an axis is given for images, a series
/// is given for input that is not DICOM or does not have it, or there are several volumes or
/// folders of images. Warnings: other_input, and those of the readers.
Result<std::unique_ptr<SliceStack>> open_stack(const std::vector<std::filesystem::path>& inputs,
                                               const OpenOptions& options);

/// Can the file be part of a scan, so that it must not be overwritten? It can if its name is that
/// of an image or a NIfTI file, or its first bytes are those of a DICOM file.
bool is_scan_file(const std::filesystem::path& file);

}  // namespace trocar::pipeline
