// SPDX-License-Identifier: GPL-3.0-or-later
// The program trocar-mesh apart from main(), so that a test program can call it too.
#pragma once

namespace trocar::pipeline {

/// Runs the command that the arguments of main() name, and returns the exit code.
int trocar_mesh(int argc, char** argv);

}  // namespace trocar::pipeline
