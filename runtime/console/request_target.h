// SPDX-License-Identifier: Apache-2.0
// Parses the target of an HTTP request: a path and its parameters.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>

namespace trocar::runtime {

/// Path and parameters of a target such as "/path?name=value&name2=value2", percent-decoded. In
/// parameters, "+" is a blank, as in the forms and the URLSearchParams of browsers.
struct RequestTarget {
  std::string path;  ///< begins with '/'
  std::map<std::string, std::string> parameters;

  /// Parses a target. Returns nullopt if the text is malformed, repeats a parameter, or has
  /// more than 8 parameters.
  static std::optional<RequestTarget> parse(std::string_view text);
  /// Returns the value of a parameter, or an empty text if the parameter is missing.
  std::string parameter(const char* name) const;
};

}  // namespace trocar::runtime
