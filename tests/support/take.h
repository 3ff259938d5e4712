// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <stdexcept>
#include <utility>

#include "formats/base/result.h"

namespace trocar::test {

/// The value; std::runtime_error, with the error's message, if there is none.
template <typename T>
T take(Result<T> result) {
  if (!result) throw std::runtime_error(result.error().message);
  return std::move(*result);
}
template <typename T>
T take(std::optional<T> value) {
  if (!value) throw std::runtime_error("no value");
  return std::move(*value);
}
inline void take(const Result<void>& result) {
  if (!result) throw std::runtime_error(result.error().message);
}

}  // namespace trocar::test
