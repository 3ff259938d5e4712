// SPDX-License-Identifier: Apache-2.0
// Writes the scan as images like the paper's: one 24-bit PNG for each slice, with the same grey
// level in all three channels.
#pragma once

#include <filesystem>
#include <string>

#include "formats/base/result.h"
#include "sample_ct/render.h"

namespace trocar::sample {

/// The range of HU that the grey levels show. In the default range, one grey level stands for 5
/// HU. Bone lies well inside this range. Air lies below it and gets the lowest grey level.
/// grey = round(clamp((HU - low_hu) / (high_hu - low_hu) * 255, 0, 255)).
struct GreyWindow {
  double low_hu = -250;
  double high_hu = 1025;
};

/// The file name of slice k, counted from 0: "slice_001.png" for k = 0.
std::string png_name(int k);

/// Writes the slices, lowest first, into an existing folder. The same scan gives the same bytes.
/// Errors: kUsage if the window is empty; kUnwritable if a file cannot be written. The message then
/// names the file, and files that were written earlier stay.
Result<void> write_png(const Scan& scan, const GreyWindow& window,
                       const std::filesystem::path& folder);

std::string png_library_version();

}  // namespace trocar::sample
