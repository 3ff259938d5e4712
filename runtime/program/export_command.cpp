// SPDX-License-Identifier: Apache-2.0
#include "runtime/program/export_command.h"

#include <unistd.h>

#include <filesystem>
#include <string>
#include <system_error>
#include <vector>

#include "runtime/program/session_messages.h"

namespace trocar::runtime {

void declare_export(CommandLine& line, ExportArguments& a) {
  declare_export_options(
      line.add_command("export", "writes a recording as an HDF5 file (runs trocar-export)"), a);
}

int run_export(const ExportArguments& a) {
  std::error_code error;
  const std::filesystem::path program =
      std::filesystem::read_symlink("/proc/self/exe", error).parent_path() / "trocar-export";
  std::vector<std::string> words = {kProgram, "--output=" + a.output};
  if (a.quiet) words.emplace_back("--quiet");
  words.emplace_back("--");  // the recording's name may begin with a dash
  words.push_back(a.recording);
  std::vector<char*> pointers;
  pointers.reserve(words.size() + 1);
  for (std::string& word : words)
    pointers.push_back(word.data());
  pointers.push_back(nullptr);
  ::execv(program.c_str(), pointers.data());
  return fail(usage("export: cannot start " + program.string() + ": " +
                    std::generic_category().message(errno) +
                    "; the Debian package trocar-console has it"));
}

}  // namespace trocar::runtime
