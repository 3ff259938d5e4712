// SPDX-License-Identifier: Apache-2.0
// Who may ask the console for what: tokens with their roles, the names under which it may be
// addressed, and names of files that pages give.
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
  /// In a time that does not depend on how much of the token is right.
  Role role_of(std::string_view token) const noexcept;
  /// Of the value of an Authorization header: "Bearer TOKEN".
  Role role_of_header(std::string_view authorization) const noexcept;

 private:
  std::string operator_, view_;
};

/// The values of Host under which the server answers: names of this machine's loopback, and the
/// address that it listens on. A page of a foreign name that resolves to this machine (DNS
/// rebinding) sends its own name.
class HostNames {
 public:
  HostNames(const std::string& listen_address, std::uint16_t port);
  bool is_host(std::string_view host) const;
  /// Of a request with this Host: an Origin is sent by pages, and must be this server's.
  static bool is_origin(std::string_view origin, std::string_view host);

 private:
  std::vector<std::string> names_;
  std::string port_;
  bool any_address_ = false;  ///< listens on all: every numerical address is its own
};

/// A relative path of 1 to 8 plain names joined by '/': no "..", no control character, no name that
/// begins with '.', no backslash, at most 512 bytes.
bool is_file_name(std::string_view name) noexcept;

}  // namespace trocar::runtime
