// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/messages.h"

#include <algorithm>
#include <cctype>
#include <cstdio>

#include "formats/base/program.h"
#include "formats/base/terminal_text.h"
#include "pipeline/program/presets.h"

namespace trocar::pipeline {

std::string ending_of(const std::filesystem::path& file) {
  std::string ending = file.extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return ending;
}

int fail(const Error& error) {
  return report_error(kProgram, error);
}

void print_warning(const Warning& warning) {
  print(stderr, "%s: warning (%s): %s: %s\n", kProgram, warning.code, warning.where,
        warning.sentence);
}

}  // namespace trocar::pipeline
