// SPDX-License-Identifier: GPL-3.0-or-later
// Why a scan gives no material at all, and the name of a scan in messages.
#pragma once

#include <string>

#include "pipeline/label_names.h"
#include "pipeline/mesh_slice.h"

namespace trocar::pipeline {

/// For slices `first` to `last` (both included), all of which are without triangles: the error
/// (refused) that names the values found, the labels found where they look like a label map or
/// labels were wanted, and what to try. Reads these slices again; if that fails, its error.
Error no_material(const SliceStack& stack, int first, int last, const MeshOptions& options,
                  const LabelNames& names = {});

/// The input in messages: its file, or the folder of its files; empty if there are none.
std::string input_name(const SliceStack& stack);

}  // namespace trocar::pipeline
