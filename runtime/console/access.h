// SPDX-License-Identifier: Apache-2.0
// Access control: tokens with their roles, the host names under which the console answers, and
// names of files that a page may give.
// Tests: tests/runtime/console/console_test.cpp
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace trocar::runtime {

enum class Role : std::uint8_t {
  kNone,
  kView,      ///< "view": sees everything, commands nothing
  kOperator,  ///< "operator"
};
const char* to_string(Role role) noexcept;

/// Two tokens of 128 random bits each, in hexadecimal.
class Tokens {
 public:
  Tokens();
  const std::string& of_operator() const noexcept { return operator_; }
  const std::string& of_view() const noexcept { return view_; }
  /// Takes a time that does not depend on how much of the token is right.
  Role role_of(std::string_view token) const noexcept;
  /// The role for the value "Bearer TOKEN" of an Authorization header.
  Role role_of_header(std::string_view authorization) const noexcept;

 private:
  std::string operator_, view_;
};

/// The values of Host under which the server answers: names of this machine's loopback, and the
/// address that it listens on. A page from a foreign name that resolves to this machine (DNS
/// rebinding) sends the foreign name, so it gets no answer.
class HostNames {
 public:
  HostNames(const std::string& listen_address, std::uint16_t port);
  bool is_host(std::string_view host) const;
  /// Pages send their Origin: it must be the server of the request's Host.
  static bool is_origin(std::string_view origin, std::string_view host);

 private:
  std::vector<std::string> names_;
  std::string port_;
  bool any_address_ = false;  ///< it listens on all addresses, so every numerical one is its own
};

/// Is this a relative path of 1 to 8 plain names joined by '/'? It has at most 512 bytes, no "..",
/// no control character, no backslash, and no name that begins with '.'.
bool is_file_name(std::string_view name) noexcept;

}  // namespace trocar::runtime
