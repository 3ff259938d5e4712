// SPDX-License-Identifier: Apache-2.0
// Access control: tokens with their roles, the host names under which the console answers, the
// names of files that a page may send, and which page holds a live hand.
// Tests: tests/runtime/console/console_test.cpp, tests/runtime/console/hand_holder_test.cpp
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"

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
/// the address on which it listens, and the public URL. A page from a foreign name that resolves to this machine
/// (DNS rebinding) sends the foreign name as Host, so it gets no answer.
class HostNames {
 public:
  /// `public_url`: what public_url_of() returned, or empty.
  HostNames(const std::string& listen_address, std::uint16_t port, std::string public_url);
  bool is_host(std::string_view host) const;
  /// Pages send their Origin. Returns true if it is the server named in the request's Host.
  bool is_origin(std::string_view origin, std::string_view host) const;

 private:
  std::vector<std::string> names_;
  std::string port_;
  std::string public_url_,
      public_host_;           ///< the first with its scheme; both are empty if there is none
  bool any_address_ = false;  ///< listens on all addresses, so every numerical host is accepted
};

/// Reads the address of a tunnel or proxy, "http://HOST[:PORT]" or "https://HOST[:PORT]", as browsers state it: in lower
/// case, and without a slash at its end. Errors: (usage) anything else.
Result<std::string> public_url_of(std::string_view text);

/// Returns true if this is a relative path of 1 to 8 plain names joined by '/'. The path may
/// have at most 512 bytes, no "..", no control character, no backslash, and no name that
/// begins with '.'.
bool is_file_name(std::string_view name) noexcept;

enum class HandShare : std::uint8_t { kYours, kOther, kFree };
/// "yours", "other", "free".
const char* to_string(HandShare share) noexcept;

/// Decides which client holds the live hand of a session, and which of its messages are used. Contract
/// (tests/runtime/console/hand_holder_test.cpp):
///  1. At most one client holds the hand: the first that moves it while it is free. It holds it until it
///     lets go, leaves, or has been silent for 1 s. Messages of other clients have no effect.
///  2. On average at most 125 messages a second are used, and at most 4 at once; the others are dropped.
///     A message whose number is not above that of the client's last one is dropped, too, and counts as silence.
///     Letting go is never dropped.
class HandHolder {
 public:
  using Clock = std::chrono::steady_clock;
  /// Identifies a client; never null, never dereferenced.
  using Client = const void*;

  /// A client moves the hand. Returns true if the message is to be used.
  bool move(Client client, std::uint64_t number, Clock::time_point now) noexcept;
  /// A client lets go, or leaves. Returns true if it held the hand.
  bool let_go(Client client) noexcept;
  /// Returns true if the holder has just lost the hand by its silence.
  bool lose_silent(Clock::time_point now) noexcept;
  HandShare share_of(Client client) const noexcept {
    return holder_ == nullptr  ? HandShare::kFree
           : holder_ == client ? HandShare::kYours
                               : HandShare::kOther;
  }

 private:
  Client holder_ = nullptr;
  std::uint64_t number_ = 0;  ///< number of the holder's last message
  Clock::time_point heard_at_, credited_at_;
  double credit_ = 0;  ///< number of messages that may be used now
};

}  // namespace trocar::runtime
