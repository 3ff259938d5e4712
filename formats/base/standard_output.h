// SPDX-License-Identifier: Apache-2.0
// What a program prints is an output like its files.
#pragma once

namespace trocar {

/// The last thing that a program's main() does: `code`, or 4 and one line on stderr if not all that
/// was printed could be written (a full disk). A reader that has gone wanted no more of it.
int after_printing(const char* program, int code);

}  // namespace trocar
