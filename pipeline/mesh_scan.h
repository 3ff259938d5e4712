// SPDX-License-Identifier: GPL-3.0-or-later
// Opening a scan as the options say: what a run, its preview and a batch have in common.
#pragma once

#include "formats/base/result.h"
#include "pipeline/arguments.h"
#include "pipeline/read/labels_with_ct.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// The scan, and with --hu the CT beside it.
Result<LabelsWithCt> open_scan(const Arguments& a, const OpenOptions& options);

/// Grey levels are not HU: the default threshold has no meaning for them, and one outside 0..255
/// selects all pixels or none. Errors (usage): images without a threshold of their own. Adds the
/// warnings default_threshold, threshold_out_of_range.
Result<void> check_threshold(const Arguments& a, SliceStack& stack);

}  // namespace trocar::pipeline
