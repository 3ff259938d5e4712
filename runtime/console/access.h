// SPDX-License-Identifier: Apache-2.0
// Access control: tokens with their roles, the host names under which the console answers, and the
// names of files that a page may send.
// Tests: tests/runtime/console/console_test.cpp
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace trocar::runtime {

enum class Role : std::uint8_t {
  kNone,
  kView,      ///< "view": may see everything, but not command anything
  kOperator,  ///< "operator": may see and command everything
};
const char* to_string(Role role) noexcept;

/// Two tokens of 128 random bits each, in hexadecimal.
class Tokens {
 public:
  Tokens();
  const std::string& of_operator() const noexcept { return operator_; }
  const std::string& of_view() const noexcept { return view_; }
  /// Returns the role of a token. The time does not depend on how much of the token is right.
  Role role_of(std::string_view token) const noexcept;
  /// Returns the role for the value "Bearer TOKEN" of an Authorization header.
  Role role_of_header(std::string_view authorization) const noexcept;

 private:
  std::string operator_, view_;
};

/// The values of the Host header under which the server answers: names of this machine's loopback,
/// and the address on which it listens. A page from a foreign name that resolves to this machine
/// (DNS rebinding) sends the foreign name as Host, so it gets no answer.
class HostNames {
 public:
  HostNames(const std::string& listen_address, std::uint16_t port);
  bool is_host(std::string_view host) const;
  /// Pages send their Origin. Returns true if it is the server named in the request's Host.
  static bool is_origin(std::string_view origin, std::string_view host);

 private:
  std::vector<std::string> names_;
  std::string port_;
  bool any_address_ = false;  ///< listens on all addresses, so every numerical host is accepted
};

/// Returns true if this is a relative path of 1 to 8 plain names joined by '/'. The path may
/// have at most 512 bytes, no "..", no control character, no backslash, and no name that
/// begins with '.'.
bool is_file_name(std::string_view name) noexcept;

}  // namespace trocar::runtime
