// SPDX-License-Identifier: GPL-3.0-or-later
// Preloaded into a program, makes every file system one without hard links.
#include <unistd.h>

#include <cerrno>

extern "C" int link(const char* /*from*/, const char* /*to*/) noexcept {
  errno = EPERM;
  return -1;
}
