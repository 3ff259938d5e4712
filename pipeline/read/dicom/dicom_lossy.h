// SPDX-License-Identifier: GPL-3.0-or-later
// Finds out whether pixels have gone through lossy compression, which changes HU and outlines.
#pragma once

#include <filesystem>
#include <optional>
#include <set>
#include <vector>

#include "pipeline/read/dicom/dicom_headers.h"
#include "pipeline/read/dicom/dicom_parse.h"

namespace trocar::pipeline {

/// The lossy compression that the file states (LossyImageCompression, also in functional groups) or
/// that its transfer syntax and its compressed pixels imply; std::nullopt if there is none.
std::optional<LossyCompression> lossy_compression(DcmFileFormat& format, int frames);

/// Looks at those of `files` that are in `used`. Warnings: lossy_compression, with the number of
/// files, their methods and ratios.
void warn_of_lossy(const std::vector<DicomFile>& files, const std::set<std::filesystem::path>& used,
                   std::vector<Warning>& warnings);

}  // namespace trocar::pipeline
