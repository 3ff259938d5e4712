// SPDX-License-Identifier: Apache-2.0
// All outputs of the program: OUTDIR/png/, OUTDIR/dicom/, OUTDIR/sample.nii.gz and
// OUTDIR/sample.json. Each appears complete or not at all.
// Tests: tests/sample_ct/sample_writers_test.cpp
#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <string>

#include "formats/base/result.h"
#include "sample_ct/render.h"
#include "sample_ct/write_png.h"

namespace trocar::sample {

/// Checks, before a scan is rendered, whether it can be written to `folder`, as far as this can be
/// determined without writing. Errors: kUnwritable if it cannot.
Result<void> check_sample_folder(const std::filesystem::path& folder);

/// Writes everything to a hidden folder inside `folder` (created if needed), then moves the four
/// outputs to their final names, replacing those of an earlier run. If `progress` is given, calls
/// it before each step with the name of the step. Errors: kUnwritable if a file cannot be written
/// (the message names it), if an existing png/ or dicom/ has other files than slices of an earlier
/// run, or if `stop` is given and is set while files are being written. If an error occurs before
/// the move, existing outputs are unchanged. The hidden folder is always removed.
Result<void> write_sample_folder(const Scan& scan, const GreyWindow& window,
                                 const std::filesystem::path& folder,
                                 const std::function<void(const std::string&)>& progress = {},
                                 const std::atomic<bool>* stop = nullptr);

/// The text of sample.json: the scan's parameters, every length with its unit.
std::string describe_scan(const Scan& scan, const GreyWindow& window);

}  // namespace trocar::sample
