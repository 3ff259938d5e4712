// SPDX-License-Identifier: GPL-3.0-or-later
// Runs another program to its end.
// Tests: tests/pipeline/farm/product_test.cpp
#pragma once

#include <atomic>
#include <filesystem>
#include <string>
#include <vector>

#include "formats/base/result.h"

namespace trocar::farm {

struct Command {
  std::vector<std::string> words;     ///< the program's path, then its arguments
  std::filesystem::path folder = {};  ///< working directory; empty: that of this process
  std::filesystem::path output;       ///< file for its standard output
  std::filesystem::path errors;       ///< file for its standard error
};

/// Runs the command, which is killed if this process dies or `stop` is set. Errors have the last
/// line of its standard error as their message, without the program's name in front. Their code is
/// usage or refused if the command ended with 2 or 3, unwritable if it ended with 4, and otherwise
/// bug; the latter two are temporary.
Result<void> run_command(const Command& command, const std::atomic<bool>* stop);

}  // namespace trocar::farm
