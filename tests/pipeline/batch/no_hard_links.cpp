// SPDX-License-Identifier: Apache-2.0
// Preloaded into a program, makes every file system one without hard links.
#include <unistd.h>

#include <cerrno>

extern "C" int link(const char* /*from*/, const char* /*to*/) noexcept {
  errno = EPERM;
  return -1;
}

extern "C" int linkat(int /*from_folder*/, const char* /*from*/, int /*to_folder*/,
                      const char* /*to*/, int /*flags*/) noexcept {
  errno = EPERM;
  return -1;
}
