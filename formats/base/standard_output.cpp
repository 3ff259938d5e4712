// SPDX-License-Identifier: Apache-2.0
#include "formats/base/standard_output.h"

#include <poll.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>

#include "formats/base/result.h"
#include "formats/base/system_message.h"
#include "formats/base/terminal_text.h"

namespace trocar {
namespace {

/// Standard output is a pipe or a socket that nobody reads any more.
bool reader_is_gone() {
  pollfd out{STDOUT_FILENO, POLLOUT, 0};
  return ::poll(&out, 1, 0) > 0 && (out.revents & POLLERR) != 0;
}

}  // namespace

int finish_output(const char* program, int code) {
  const bool failed_before = std::ferror(stdout) != 0;
  errno = 0;
  const bool fails_now = std::fflush(stdout) != 0;
  if (!failed_before && !fails_now) return code;
  // An error before this call has left no errno.
  if (errno == EPIPE || (errno == 0 && reader_is_gone())) return code;
  const std::string why = errno == 0 ? "" : ": " + system_message(errno);
  print(stderr, "%s: standard output could not be written%s\n", program, why);
  return code == 0 ? static_cast<int>(ExitCode::kUnwritable) : code;
}

}  // namespace trocar
