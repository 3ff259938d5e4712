// SPDX-License-Identifier: GPL-3.0-or-later
// `trocar-mesh INPUT -o ASSET.glb`: meshes one scan.
#pragma once

#include "pipeline/program/arguments.h"

namespace trocar::pipeline {

/// Meshes the scan, writes the output and returns the exit code. If the name `a.output` ends in
/// .glb, the output is the asset; if it ends in .stl, .ply or .obj, the output is only the
/// surface. With --report, a report is written too, and with --dump-stages the intermediate
/// results of one slice.
int run_mesh(Arguments a);

}  // namespace trocar::pipeline
