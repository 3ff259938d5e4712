// SPDX-License-Identifier: Apache-2.0
// Writes the scan as a DICOM series: CT Image Storage, explicit VR little endian, one file for each
// slice. The stored values are HU + 1024. They use 12 of the 16 bits allocated for a pixel.
#pragma once

#include <filesystem>
#include <string>

#include "formats/base/result.h"
#include "sample_ct/render.h"

namespace trocar::sample {

/// The file name of slice k, counted from 0: "CT_001.dcm" for k = 0, whose InstanceNumber is 1.
std::string dicom_name(int k);

/// A UID under the root 2.25 (a UUID as a decimal number). The UID depends only on the scan's
/// parameters, the program's version, and `purpose` ("study", "series", "frame", "image/3").
std::string dicom_uid(const Scan& scan, const std::string& purpose);

/// Writes the slices, lowest first, into an existing folder. Errors: kUnwritable; the message names
/// the file, and files that were written earlier stay. The same scan gives the same bytes: dates
/// are constant, and UIDs depend on the scan's parameters (dicom_uid()).
Result<void> write_dicom(const Scan& scan, const std::filesystem::path& folder);

std::string dicom_library_version();

}  // namespace trocar::sample
