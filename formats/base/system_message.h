// SPDX-License-Identifier: Apache-2.0
// The system's message for an error number.
// Tests: tests/formats/base/file_io_test.cpp
#pragma once

#include <string>
#include <system_error>

namespace trocar {

/// The message for `error`, a value of errno, for example "No such file or directory". Thread-safe.
inline std::string system_message(int error) {
  return std::generic_category().message(error);
}

}  // namespace trocar
