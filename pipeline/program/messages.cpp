// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/messages.h"

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <cstdlib>

#include "formats/base/program.h"
#include "formats/base/terminal_text.h"
#include "pipeline/farm/command.h"
#include "pipeline/program/presets.h"

namespace trocar::pipeline {

std::string ending_of(const std::filesystem::path& file) {
  std::string ending = file.extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return ending;
}

int fail(const Error& error) {
  const int code = report_error(kProgram, error);
  if (error.code != ExitCode::kRefused || !error.is_temporary) return code;
  // NOLINTNEXTLINE(concurrency-mt-unsafe): nothing changes the environment
  return std::getenv(farm::kExitForNowVariable) == nullptr ? code : farm::kExitForNow;
}

void print_warning(const Warning& warning) {
  print(stderr, "%s: warning (%s): %s: %s\n", kProgram, warning.code, warning.where,
        warning.sentence);
}

}  // namespace trocar::pipeline
