// SPDX-License-Identifier: GPL-3.0-or-later
// The error for a scan without any triangles.
#pragma once

#include <string>

#include "pipeline/scan/label_names.h"
#include "pipeline/scan/mesh_slice.h"

namespace trocar::pipeline {

/// Returns the error (kRefused) for a scan in which no slice from `first` to `last`, both included,
/// has triangles. The function does not check this. The message gives the reason, the values in the
/// slices, and options to try. If the values look like a label map, the message also lists the
/// labels. The function reads the slices again; if reading fails, it returns the error of reading.
Error empty_asset_error(const SliceStack& stack, int first, int last, const MeshOptions& options,
                        const LabelNames& names = {});

}  // namespace trocar::pipeline
