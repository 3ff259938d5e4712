// SPDX-License-Identifier: GPL-3.0-or-later
// Opening a scan with the options of the command line, for a run, a preview or a batch.
// Tests: tests/e2e/mesh_program_e2e_test.py
#pragma once

#include <filesystem>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/open/labels_with_ct.h"
#include "pipeline/program/arguments.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Opens the scan and, with --hu, the CT on the same grid.
Result<LabelsWithCt> open_scan(const Arguments& a, const OpenOptions& options);

/// All files that are read. An output must not overwrite one of them.
std::vector<std::filesystem::path> files_read(const Arguments& a, const LabelsWithCt& scan);

/// Checks whether the threshold makes sense for the scan's values. The default threshold and the
/// presets have no meaning for grey levels. A threshold outside 0..255 selects all pixels of an
/// image or none. Adds the warnings default_threshold and threshold_out_of_range. Errors: kUsage if
/// the scan consists of images and no threshold, or a preset, was given.
Result<void> check_threshold(const Arguments& a, SliceStack& stack);

}  // namespace trocar::pipeline
