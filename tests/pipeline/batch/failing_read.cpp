// SPDX-License-Identifier: Apache-2.0
// Preloaded into a program, makes one read of the file $TROCAR_FAIL_READ fail with EIO. The file
// $TROCAR_FAIL_READ.once has the number of reads that succeed before; it is removed at the failure.
#include <dlfcn.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <fstream>
#include <string>

namespace {

bool must_fail(int fd) {
  const char* const file = std::getenv("TROCAR_FAIL_READ");  // NOLINT(concurrency-mt-unsafe)
  if (file == nullptr) return false;
  char path[4096];
  const std::string link = "/proc/self/fd/" + std::to_string(fd);
  const ssize_t n = ::readlink(link.c_str(), path, sizeof path);
  if (n < 0 || std::string(path, static_cast<std::size_t>(n)) != file) return false;
  const std::string once = std::string(file) + ".once";
  int left = 0;
  if (!(std::ifstream(once) >> left)) return false;
  if (left == 0) return ::unlink(once.c_str()) == 0;
  std::ofstream(once) << left - 1;
  return false;
}

template <typename... Arguments>
ssize_t read_by(const char* name, int fd, Arguments... arguments) {
  if (must_fail(fd)) {
    errno = EIO;
    return -1;
  }
  using Read = ssize_t (*)(int, Arguments...);
  return reinterpret_cast<Read>(::dlsym(RTLD_NEXT, name))(fd, arguments...);
}

}  // namespace

extern "C" ssize_t read(int fd, void* into, std::size_t bytes) {
  return read_by("read", fd, into, bytes);
}

extern "C" ssize_t pread(int fd, void* into, std::size_t bytes, off_t at) {
  return read_by("pread", fd, into, bytes, at);
}

extern "C" ssize_t pread64(int fd, void* into, std::size_t bytes, off64_t at) {
  return read_by("pread64", fd, into, bytes, at);
}
