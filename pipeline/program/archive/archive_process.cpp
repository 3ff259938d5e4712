// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/archive/archive_process.h"

#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <string>
#include <system_error>

#include "formats/base/program.h"
#include "pipeline/archive/messages.h"

namespace trocar::pipeline {

int become_trocar_archive(char** argv) {
  std::error_code unreadable;
  const std::filesystem::path own = std::filesystem::read_symlink("/proc/self/exe", unreadable);
  const std::filesystem::path program =
      own.parent_path().parent_path() / "libexec" / "trocar" / "trocar-archive";
  ::execv(program.c_str(), argv);
  return report_error(archive::kProgram,
                      {ExitCode::kBug, program.string() + ": cannot be run (" +
                                           std::generic_category().message(errno) +
                                           "); reinstall or rebuild trocar-mesh"});
}

}  // namespace trocar::pipeline
