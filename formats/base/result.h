// SPDX-License-Identifier: Apache-2.0
// A value, or an error with its message and the exit code of the program.
#pragma once

#include <cassert>
#include <optional>
#include <string>
#include <utility>

namespace trocar {

/// The exit codes of all programs.
enum class ExitCode : int {
  kDone = 0,
  kBug = 1,          ///< an internal invariant does not hold
  kUsage = 2,        ///< wrong options or arguments
  kRefused = 3,      ///< the input is not acceptable
  kUnwritable = 4,   ///< an output could not be written
  kDeviceFault = 5,  ///< the device or the safety layer, or a signal, stopped the work
};

struct Error {
  ExitCode code = ExitCode::kBug;
  std::string message;  ///< one line with the reason and, if they apply, file, slice, position
  /// True if the cause lies outside the input, for example in a lack of memory. Another try with
  /// the same input may succeed.
  bool is_temporary = false;
  /// The same error with `prefix` before its message.
  Error after(const std::string& prefix) const { return {code, prefix + message, is_temporary}; }
};

template <typename T>
class Result;

/// Success, or an Error.
template <>
class [[nodiscard]] Result<void> {
 public:
  Result() = default;
  Result(Error error) : error_(std::move(error)) {}  // NOLINT(google-explicit-constructor)
  explicit operator bool() const { return !error_.has_value(); }
  const Error& error() const { return assert(error_), *error_; }

 private:
  std::optional<Error> error_;
};

/// Holds a T or an Error. Access to a T that is not there, or to an Error that is not there, is a
/// bug (assert).
template <typename T>
class [[nodiscard]] Result {
 public:
  Result(T value) : value_(std::move(value)) {}      // NOLINT(google-explicit-constructor)
  Result(Error error) : error_(std::move(error)) {}  // NOLINT(google-explicit-constructor)

  explicit operator bool() const { return value_.has_value(); }
  T& operator*() { return assert(value_), *value_; }
  const T& operator*() const { return assert(value_), *value_; }
  T* operator->() { return assert(value_), &*value_; }
  const T* operator->() const { return assert(value_), &*value_; }
  const Error& error() const { return assert(!value_), error_; }
  /// Moves the value to `to`, or returns the error.
  template <typename To>
  Result<void> into(To& to) && {
    if (!value_) return std::move(error_);
    to = *std::move(value_);
    return {};
  }

 private:
  std::optional<T> value_;
  Error error_;
};

// Each of these functions makes an Error with one exit code. refused_for_now() also sets
// is_temporary.

inline Error refused(std::string message) {
  return {ExitCode::kRefused, std::move(message)};
}
inline Error refused_for_now(std::string message) {
  return {ExitCode::kRefused, std::move(message), true};
}
inline Error usage(std::string message) {
  return {ExitCode::kUsage, std::move(message)};
}
inline Error unwritable(std::string message) {
  return {ExitCode::kUnwritable, std::move(message)};
}
inline Error bug(std::string message) {
  return {ExitCode::kBug, std::move(message)};
}

}  // namespace trocar
