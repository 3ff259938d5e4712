// SPDX-License-Identifier: GPL-3.0-or-later
// Prints errors and warnings of trocar-mesh, and finds the endings of file names.
#pragma once

#include <filesystem>
#include <string>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

inline constexpr const char* kProgram = "trocar-mesh";

/// Prints the error's message to standard error and returns the error's exit code.
int fail(const Error& error);

/// Prints a warning to standard error.
void print_warning(const Warning& warning);

/// The extension of a file name in lower case, with its dot; empty if there is none.
std::string ending_of(const std::filesystem::path& file);

}  // namespace trocar::pipeline
