// SPDX-License-Identifier: Apache-2.0
// Answers the requests whose path begins with /api/ (protocol.md). Precondition: the caller has
// checked the request's Host, Origin and token. This code does not use sockets.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <variant>

#include "runtime/console/access.h"
#include "runtime/console/console_state.h"
#include "runtime/console/request_target.h"

namespace trocar::runtime {

inline constexpr const char* kPolicyOfData = "default-src 'none'; frame-ancestors 'none'";

/// Status codes of HTTP.
inline constexpr unsigned kBadRequest = 400, kUnauthorized = 401, kForbidden = 403, kNotFound = 404,
                          kMethodNotAllowed = 405, kConflict = 409, kBodyTooLong = 413,
                          kMisdirected = 421, kUnprocessable = 422, kUpgradeRequired = 426,
                          kHeaderTooLong = 431, kInternalError = 500;

struct Answer {
  unsigned status = 200;  ///< HTTP status
  std::string type = "application/json", body;
  std::string policy = kPolicyOfData;  ///< Content-Security-Policy
  /// If not null, this body is sent instead of `body`. Several answers can share it without a copy.
  std::shared_ptr<const std::string> shared = {};
};

/// Returns an answer with the JSON object {"ok": false, "error": message}.
Answer failure(unsigned status, const std::string& message);
Answer method_not_allowed();

struct ApiRequest {
  RequestTarget target;
  bool is_get = false, is_post = false;
  Role role = Role::kNone;  ///< kView or kOperator
  std::string body;
  std::string from;  ///< address of the peer, for the log
};

/// An answer, or a function that makes the answer. If it is a function, the caller must run it on
/// the worker thread (ConsoleState::worker), because it may read large files.
using Reply = std::variant<Answer, std::function<Answer()>>;

Reply answer_api(ConsoleState& console, const ApiRequest& request);

/// Answers a request for an emergency stop. This request needs no token, so call this function
/// before you check the role.
Answer answer_emergency_stop(ConsoleState& console);

}  // namespace trocar::runtime
