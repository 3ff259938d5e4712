// SPDX-License-Identifier: Apache-2.0
// Writes the scan as one NIfTI-1 file: int16 HU, with a qform and a sform to RAS in mm that agree
// with the DICOM series' LPS geometry.
#pragma once

#include <filesystem>
#include <string>

#include "formats/base/result.h"
#include "sample_ct/render.h"

namespace trocar::sample {

/// Writes a .nii.gz atomically. The same scan gives the same bytes: the gzip header has no name and
/// no time. Errors: kUnwritable if the file cannot be written; kBug if libnifti or zlib fails.
Result<void> write_nifti(const Scan& scan, const std::filesystem::path& file);

std::string nifti_library_version();

}  // namespace trocar::sample
