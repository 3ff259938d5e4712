// SPDX-License-Identifier: Apache-2.0
// The program trocar-console apart from main(): the command line of the operator's console, which
// is runtime/console.
#pragma once

namespace trocar::runtime {

/// Does what the arguments of main() ask for, and returns the exit code.
int trocar_console(int argc, char** argv);

}  // namespace trocar::runtime
