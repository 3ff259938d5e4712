// SPDX-License-Identifier: Apache-2.0
// Errors in writing standard output.
// Tests: tests/e2e/wrong_uses_test.py
#pragma once

namespace trocar {

/// Flushes standard output and returns the exit code; call it last in main(). The result is `code`.
/// If `code` is 0 and not everything printed could be written, for example on a full disk, the
/// result is 4 (unwritable), with a line on stderr. A closed pipe is not an error.
int finish_output(const char* program, int code);

}  // namespace trocar
