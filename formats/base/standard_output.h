// SPDX-License-Identifier: Apache-2.0
// Errors in writing standard output.
// Tests: tests/e2e/wrong_uses_test.py
#pragma once

namespace trocar {

/// Flushes standard output and returns the program's exit code; call this function last in main().
/// If not everything that was printed could be written, for example because the disk is full,
/// prints a line on stderr. If `code` is 0, the exit code is then 4 (kUnwritable). In all
/// other cases the exit code is `code`. A closed pipe does not count as a failure.
int finish_output(const char* program, int code);

}  // namespace trocar
