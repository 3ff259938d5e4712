// SPDX-License-Identifier: Apache-2.0
// Flushes standard output at the end of a program, and reports text that could not be written.
#pragma once

namespace trocar {

/// Flushes standard output and returns the program's exit code; call this function last in main().
/// If some printed text could not be written, for example because the disk is full, the function
/// prints a line on stderr and replaces a `code` of 0 by 4 (kUnwritable). Otherwise the exit code
/// is `code`. A closed pipe does not count as a failure.
int finish_output(const char* program, int code);

}  // namespace trocar
