// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/archive/messages.h"

#include <unistd.h>

namespace trocar::archive {
namespace {

// A line that cannot be printed is lost: the receiver goes on.
void print(int fd, const std::string& line) {
  if (::write(fd, line.data(), line.size()) < 0) return;
}

}  // namespace

void report(const std::string& text) {
  print(STDERR_FILENO, std::string(kProgram) + ": " + text + "\n");
}

void announce(const std::string& text) {
  print(STDOUT_FILENO, text + "\n");
}

}  // namespace trocar::archive
