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

/// Opens a list of files, or what search_folder() takes of one folder. Errors: (refused) nothing
/// usable, sizes differ, broken file, an axis for DICOM slices that are no regular volume; (usage)
/// spacing missing, an axis for images, a series for input that is not DICOM or one that is not
/// there, several volumes or folders of images. Warnings: those of the readers.
Result<std::unique_ptr<SliceStack>> open_stack(const std::vector<std::filesystem::path>& inputs,
                                               const OpenOptions& options);

/// Whether the file may be part of a scan and must not be overwritten: an image or a NIfTI by its
/// name, or a DICOM file by its first bytes.
bool is_scan_file(const std::filesystem::path& file);

}  // namespace trocar::pipeline
