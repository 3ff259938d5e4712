// SPDX-License-Identifier: GPL-3.0-or-later
// `trocar-mesh INPUT -o ASSET.glb`: meshes one scan.
// Tests: tests/e2e/mesh_program_e2e_test.py
#pragma once

#include "pipeline/program/arguments.h"

namespace trocar::pipeline {

/// Meshes the scan and returns the exit code. Asset, report and stages (--dump-stages) are each
/// written only if `a` names a file for it.
int run_mesh(const Arguments& a);

}  // namespace trocar::pipeline
