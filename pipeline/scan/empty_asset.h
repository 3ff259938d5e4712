// SPDX-License-Identifier: GPL-3.0-or-later
// The error for a scan without any triangles.
// Tests: tests/e2e/mesh_program_e2e_test.py
#pragma once

#include <string>

#include "pipeline/scan/label_names.h"
#include "pipeline/scan/mesh_slice.h"

namespace trocar::pipeline {

/// Makes the error kRefused for the case that none of the slices `first` to `last` (both included)
/// has triangles. The message states the values in the slices, or the labels if the values look
/// like a label map, and suggests what to try. The slices are read again; if this fails, the error
/// of reading is returned.
Error empty_asset_error(const SliceStack& stack, int first, int last, const MeshOptions& options,
                        const LabelNames& names = {});

}  // namespace trocar::pipeline
