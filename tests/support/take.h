// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <stdexcept>
#include <utility>

#include "formats/base/result.h"

namespace trocar::test {

/// The value of a result; std::runtime_error with its message if it is an error.
template <typename T>
T take(Result<T> result) {
  if (!result) throw std::runtime_error(result.error().message);
  return std::move(*result);
}
inline void take(const Result<void>& result) {
  if (!result) throw std::runtime_error(result.error().message);
}

}  // namespace trocar::test
