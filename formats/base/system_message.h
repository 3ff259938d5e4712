// SPDX-License-Identifier: Apache-2.0
// The system's message for an error number.
// Tests: tests/formats/base/file_io_test.cpp
#pragma once

#include <string>
#include <system_error>

namespace trocar {

/// The message of errno's value `error`, for example "No such file or directory". Safe in any thread.
inline std::string system_message(int error) {
  return std::generic_category().message(error);
}

}  // namespace trocar
