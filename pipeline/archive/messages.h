// SPDX-License-Identifier: GPL-3.0-or-later
// Prints the messages of `trocar-mesh receive` and `trocar-mesh fetch`. Several processes of one
// program may print at the same time. Each line is one call of write(), so that lines of several
// processes do not mix.
#pragma once

#include <string>

namespace trocar::archive {

inline constexpr const char* kProgram = "trocar-mesh";

/// Prints "trocar-mesh: TEXT" on standard error.
void report(const std::string& text);
/// Prints a line on standard output.
void announce(const std::string& text);

}  // namespace trocar::archive
