// SPDX-License-Identifier: GPL-3.0-or-later
// Runs another program to its end.
#pragma once

#include <atomic>
#include <filesystem>
#include <string>
#include <vector>

#include "formats/base/result.h"

namespace trocar::farm {

/// run_command() sets this variable in the environment of the command. The variable changes an exit
/// code of trocar-mesh: if an input was refused for a reason that lies outside of the input
/// (Error::is_temporary), for example because the disk was full, the code is kExitForNow, not 3.
inline constexpr const char* kExitForNowVariable = "TROCAR_EXIT_FOR_NOW";
inline constexpr int kExitForNow = 75;  ///< EX_TEMPFAIL of sysexits.h

struct Command {
  std::vector<std::string> words;     ///< the program's path, then its arguments
  std::filesystem::path folder = {};  ///< working directory; empty: that of this process
  std::filesystem::path output;       ///< file for the command's standard output
  std::filesystem::path errors;       ///< file for the command's standard error
};

/// Runs the command and waits for its end. The command is killed if this process dies or `stop` is
/// set; `stop` may be null. Errors: kUsage if the command ended with exit code 2; kRefused with
/// exit code 3 or kExitForNow; kUnwritable with exit code 4; kBug if it ended in another way or
/// cannot be started. After kExitForNow, kUnwritable and kBug another try may succeed
/// (Error::is_temporary is set). The message is the last line of the command's standard error,
/// without the program's name in front. If a signal ended the command, or this line is empty, the
/// message says how the command ended.
Result<void> run_command(const Command& command, const std::atomic<bool>* stop);

}  // namespace trocar::farm
