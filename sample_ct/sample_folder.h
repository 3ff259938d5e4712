// SPDX-License-Identifier: Apache-2.0
// All outputs of the program: OUTDIR/png/, OUTDIR/dicom/, OUTDIR/sample.nii.gz and
// OUTDIR/sample.json. Each of these four appears complete or not at all.
#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <string>

#include "formats/base/result.h"
#include "sample_ct/render.h"

namespace trocar::sample {

// Writes the scan as images like the paper's: one 24-bit PNG for each slice, with the same grey
// level in all three channels.

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

/// Checks whether a scan can be written to `folder`, as far as a check without writing can tell.
/// Call this function before a scan is rendered. Errors: kUnwritable if the scan cannot be written.
Result<void> check_sample_folder(const std::filesystem::path& folder);

/// Writes all outputs to a hidden folder inside `folder`, then moves the four outputs to their
/// final names, replacing outputs of an earlier run. Creates `folder` if needed. Before each step,
/// calls `progress`, if given, with the name of the step. Errors: kUnwritable if a file cannot be
/// written (the message names the file), if an existing png/ or dicom/ has files that are not
/// slices of an earlier run, or if `*stop` is set before all files are written; those of
/// write_png() and write_nifti(). If an error occurs before the move, existing outputs are
/// unchanged. The hidden folder is always removed.
Result<void> write_sample_folder(const Scan& scan, const GreyWindow& window,
                                 const std::filesystem::path& folder,
                                 const std::function<void(const std::string&)>& progress = {},
                                 const std::atomic<bool>* stop = nullptr);

}  // namespace trocar::sample
