// SPDX-License-Identifier: Apache-2.0
// Targets of HTTP requests, and access control of the console.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"

namespace trocar::runtime {

// Parses the target of an HTTP request: a path and its parameters.

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

// Access control of the console: tokens and the roles that they give, the host names under which
// the console answers, the file names that a page may send, and which page holds the live hand (a
// hand that a person moves while the session runs).

enum class Role : std::uint8_t {
  kNone,
  kView,      ///< "view": may see everything, but not command anything
  kOperator,  ///< "operator": may see and command everything
};
const char* to_string(Role role) noexcept;

/// The operator's token and the audience's token (role kView). Each has 128 random bits, in
/// hexadecimal. A client shows by its token which role it has.
class Tokens {
 public:
  Tokens();
  const std::string& of_operator() const noexcept { return operator_; }
  const std::string& of_view() const noexcept { return view_; }
  /// Returns the role of a token, or kNone for a wrong token. The duration of the call does not
  /// reveal how many characters of a wrong token are right.
  Role role_of(std::string_view token) const noexcept;
  /// Returns the role for the value of an Authorization header: that of TOKEN if the value is
  /// "Bearer TOKEN", otherwise kNone.
  Role role_of_header(std::string_view authorization) const noexcept;

 private:
  std::string operator_, view_;
};

/// The values of the Host header to which the server answers: 127.0.0.1, localhost, [::1], the
/// address on which the server listens, and the host of the public URL. The check protects against
/// DNS rebinding, in which a foreign server makes its own host name resolve to this machine. The
/// requests of that server's pages then reach this machine, but with the foreign name as Host, so
/// they get no answer.
class HostNames {
 public:
  /// `public_url`: a result of public_url_of(), or empty.
  HostNames(const std::string& listen_address, std::uint16_t port, std::string public_url);
  bool is_host(std::string_view host) const;
  /// Returns true if `origin` and `host` are the same server. `origin`: the Origin header of a
  /// request, which names the server from which the page came. `host`: the Host header.
  bool is_origin(std::string_view origin, std::string_view host) const;

 private:
  std::vector<std::string> names_;
  std::string port_;
  /// public_url_: the public URL with its scheme. public_host_: the public URL without the scheme.
  /// Both are empty if there is no public URL.
  std::string public_url_, public_host_;
  bool any_address_ = false;  ///< listens on all addresses, so every numerical host is accepted
};

/// Reads the public URL of the console, which is the address of a tunnel or proxy:
/// "http://HOST[:PORT]" or "https://HOST[:PORT]". Returns the URL in the form that browsers send:
/// in lower case, and without a slash at the end. Errors: kUsage if the text is anything else.
Result<std::string> public_url_of(std::string_view text);

/// Returns true if `name` is a relative path of 1 to 8 plain names joined by '/'. The path may
/// have at most 512 bytes, no "..", no control character, no backslash, and no name that
/// begins with '.'.
bool is_file_name(std::string_view name) noexcept;

/// Who holds the live hand, from the view of one client: this client, another client, or nobody.
enum class HandShare : std::uint8_t { kYours, kOther, kFree };
/// "yours", "other", "free".
const char* to_string(HandShare share) noexcept;

/// Decides which client (page or script) holds the live hand of a session, and which of the
/// holder's messages go to the session. Contract:
///  1. At most one client holds the hand. If nobody holds the hand, the first client that moves the
///     hand becomes the holder. The holder keeps the hand until it lets go, disconnects, or has
///     been silent for 1 s. Messages of other clients have no effect.
///  2. At most 4 messages go to the session at once, and on average at most 125 in a second.
///     Further messages are dropped. If the number of a message is not above the number of the
///     holder's previous message, the message is dropped, and the holder still counts as silent.
///     Letting go is never dropped.
class HandHolder {
 public:
  using Clock = std::chrono::steady_clock;
  /// A pointer that identifies a client. The pointer is never null, and is not dereferenced.
  using Client = const void*;

  /// Call this for each message with which a client moves the hand. `number`: the message's number.
  /// Returns true if the caller is to pass the message on to the session.
  bool move(Client client, std::uint64_t number, Clock::time_point now) noexcept;
  /// Call this when a client lets go or disconnects. Returns true if this client held the hand.
  bool let_go(Client client) noexcept;
  /// If the holder has been silent for 1 s, takes the hand from the holder and returns true.
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
  double credit_ = 0;  ///< number of messages that could be passed on at the time `credited_at_`
};

}  // namespace trocar::runtime
