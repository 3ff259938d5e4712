// SPDX-License-Identifier: GPL-3.0-or-later
// Why a scan gives no material at all.
#pragma once

#include "pipeline/mesh_slice.h"

namespace trocar::pipeline {

/// For slices `first` to `last` (both included), all of which are without triangles: the error
/// (refused) that names the values found, the labels found where they look like a label map or
/// labels were wanted, and what to try. Reads these slices again; if that fails, its error.
Error no_material(const SliceStack& stack, int first, int last, const MeshOptions& options);

}  // namespace trocar::pipeline
