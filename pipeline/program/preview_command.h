// SPDX-License-Identifier: GPL-3.0-or-later
// `trocar-mesh preview`: writes a picture or page of what a run with the same options would mesh.
// Tests: tests/e2e/preview_test.py
#pragma once

#include "pipeline/program/arguments.h"

namespace trocar::pipeline {

/// Writes the picture or page and returns the exit code.
int run_preview(const Arguments& a);

}  // namespace trocar::pipeline
