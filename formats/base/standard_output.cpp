// SPDX-License-Identifier: Apache-2.0
#include "formats/base/standard_output.h"

#include <cerrno>
#include <cstdio>

#include "formats/base/result.h"
#include "formats/base/system_message.h"

namespace trocar {

int finish_output(const char* program, int code) {
  const bool failed_before = std::ferror(stdout) != 0;
  errno = 0;
  const bool fails_now = std::fflush(stdout) != 0;
  if ((!failed_before && !fails_now) || errno == EPIPE) return code;
  const std::string why = errno == 0 ? "" : ": " + system_message(errno);
  std::fprintf(stderr, "%s: standard output could not be written%s\n", program, why.c_str());
  return code == 0 ? static_cast<int>(ExitCode::kUnwritable) : code;
}

}  // namespace trocar
