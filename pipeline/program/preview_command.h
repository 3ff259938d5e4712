// SPDX-License-Identifier: GPL-3.0-or-later
// `trocar-mesh preview`: writes a picture (.png) or a page (.html) of what trocar-mesh would mesh
// with the same options.
#pragma once

#include "pipeline/program/arguments.h"

namespace trocar::pipeline {

/// Writes the picture or page and returns the exit code.
int run_preview(Arguments a);

}  // namespace trocar::pipeline
