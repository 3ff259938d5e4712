// SPDX-License-Identifier: Apache-2.0
// Errors of the system: their messages, and whether another try may succeed.
#pragma once

#include <cerrno>
#include <string>
#include <system_error>

#include "formats/base/result.h"

namespace trocar {

/// The message for `error`, a value of errno, for example "No such file or directory". Thread-safe.
inline std::string system_message(int error) {
  return std::generic_category().message(error);
}

/// Does the reason `error` lie outside of the input (Error::is_temporary)? False for what is wrong with
/// the path itself. The storage, the memory, the number of open files and the rights may change while
/// the input stays the same.
inline bool is_of_circumstances(int error) {
  return error != ENOENT && error != ENOTDIR && error != ELOOP && error != EISDIR &&
         error != ENAMETOOLONG && error != EINVAL && error != ENXIO;
}

/// The refusal of an input that the system did not give, for the reason `error`: "WHAT: REASON".
inline Error refused_by_system(const std::string& what, int error) {
  return {ExitCode::kRefused, what + ": " + system_message(error), is_of_circumstances(error)};
}

}  // namespace trocar
