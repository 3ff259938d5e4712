// SPDX-License-Identifier: GPL-3.0-or-later
// The error for a scan without any triangles.
// Tests: tests/e2e/mesh_program_e2e_test.py
#pragma once

#include <string>

#include "pipeline/scan/label_names.h"
#include "pipeline/scan/mesh_slice.h"

namespace trocar::pipeline {

/// The error (refused) for slices `first` to `last` (both included) if none has triangles. It names
/// the values in the slices and what to try. It lists the labels if the values look like a label
/// map or labels were wanted. Reads the slices again and returns the error of reading if this
/// fails.
Error empty_asset_error(const SliceStack& stack, int first, int last, const MeshOptions& options,
                        const LabelNames& names = {});

}  // namespace trocar::pipeline
