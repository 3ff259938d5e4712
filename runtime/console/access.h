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
  /// Returns the role of a token. The time that this takes does not depend on how many characters
  /// of a wrong token are right.
  Role role_of(std::string_view token) const noexcept;
  /// Returns the role for the value "Bearer TOKEN" of an Authorization header.
  Role role_of_header(std::string_view authorization) const noexcept;

 private:
  std::string operator_, view_;
};

/// The values of the Host header under which the server answers: names of this machine's loopback,
/// the address on which the server listens, and the host of the public URL. This protects against
/// DNS rebinding: a page from a foreign name that resolves to this machine sends that foreign name
/// as Host, so the page gets no answer.
class HostNames {
 public:
  /// `public_url`: a result of public_url_of(), or empty.
  HostNames(const std::string& listen_address, std::uint16_t port, std::string public_url);
  bool is_host(std::string_view host) const;
  /// Returns true if `origin` (a request's Origin header: the server from which the page came) and
  /// `host` (the request's Host header) are the same server.
  bool is_origin(std::string_view origin, std::string_view host) const;

 private:
  std::vector<std::string> names_;
  std::string port_;
  /// The public URL with its scheme, and its host; both are empty if there is no public URL.
  std::string public_url_, public_host_;
  bool any_address_ = false;  ///< listens on all addresses, so every numerical host is accepted
};

/// Reads the address of a tunnel or proxy, "http://HOST[:PORT]" or "https://HOST[:PORT]". Returns
/// it in the form that browsers send: in lower case, and without a slash at its end. Errors: kUsage
/// if the text is anything else.
Result<std::string> public_url_of(std::string_view text);

/// Returns true if `name` is a relative path of 1 to 8 plain names joined by '/'. The path may
/// have at most 512 bytes, no "..", no control character, no backslash, and no name that
/// begins with '.'.
bool is_file_name(std::string_view name) noexcept;

/// Who holds the live hand (a hand that a person moves from a page), from the view of one client:
/// this client, another one, or nobody.
enum class HandShare : std::uint8_t { kYours, kOther, kFree };
/// "yours", "other", "free".
const char* to_string(HandShare share) noexcept;

/// Decides which client holds the live hand of a session, and which messages of this client are
/// used. Contract (tests/runtime/console/hand_holder_test.cpp):
///  1. At most one client holds the hand: the first client that moves the hand while nobody holds
///     it. The client holds the hand until the client lets go, leaves, or has been silent for 1 s.
///     Messages of other clients have no effect.
///  2. On average at most 125 messages a second are used, and at most 4 in immediate succession;
///     further messages are dropped. A message whose number is not above that of the holder's
///     previous message is dropped, too, and does not end the silence. Letting go is never dropped.
class HandHolder {
 public:
  using Clock = std::chrono::steady_clock;
  /// A pointer that identifies a client; never null, never dereferenced.
  using Client = const void*;

  /// Call this if a client moves the hand. Returns true if the message is to be used.
  bool move(Client client, std::uint64_t number, Clock::time_point now) noexcept;
  /// Call this if a client lets go, or leaves. Returns true if this client held the hand.
  bool let_go(Client client) noexcept;
  /// If the holder has been silent for too long, takes the hand from it and returns true.
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
  double credit_ = 0;  ///< number of messages that may be used at `credited_at_`
};

}  // namespace trocar::runtime
