// SPDX-License-Identifier: Apache-2.0
// The program's output as a whole: OUTDIR/png/, OUTDIR/dicom/, OUTDIR/sample.nii.gz
// and OUTDIR/sample.json, each of which appears complete or not at all.
#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <string>

#include "formats/base/result.h"
#include "sample_ct/render.h"
#include "sample_ct/write_png.h"

namespace trocar::sample {

/// Writes everything to a hidden folder inside `folder` (made if need be), then moves
/// the four outputs into place, replacing those of an earlier run. On failure
/// (unwritable, naming the file) what was there before is still there and the hidden
/// folder is gone. An existing png/ or dicom/ that holds anything but an earlier
/// run's slices is not replaced: unwritable; as is all once `stop`, if given, is set. `progress`,
/// if given, is told what comes next.
Result<void> write_sample_folder(const Scan& scan, const GreyWindow& window,
                                 const std::filesystem::path& folder,
                                 const std::function<void(const std::string&)>& progress = {},
                                 const std::atomic<bool>* stop = nullptr);

/// sample.json: what the scan is, every length with its unit.
std::string describe_scan(const Scan& scan, const GreyWindow& window);

}  // namespace trocar::sample
