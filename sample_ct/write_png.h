// SPDX-License-Identifier: Apache-2.0
// Writes the scan as images like the paper's: one 24-bit PNG for each slice, with the same grey
// level in all three channels.
// Tests: tests/sample_ct/sample_writers_test.cpp
#pragma once

#include <filesystem>
#include <string>

#include "formats/base/result.h"
#include "sample_ct/render.h"

namespace trocar::sample {

/// grey = round(clamp((HU - low) / (high - low) * 255, 0, 255)): 5 HU per grey level by default.
/// Bone is well inside the range; air is clamped.
struct GreyWindow {
  double low_hu = -250;
  double high_hu = 1025;
};

/// The file of slice k (counted from 0): "slice_001.png" for k = 0.
std::string png_name(int k);

/// Writes the slices, lowest first, into an existing folder. An error (unwritable)
/// names the file; files written before it stay. The same scan gives the same bytes.
Result<void> write_png(const Scan& scan, const GreyWindow& window,
                       const std::filesystem::path& folder);

std::string png_library_version();

}  // namespace trocar::sample
