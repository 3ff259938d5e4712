// SPDX-License-Identifier: Apache-2.0
// Messages to clients, and answers to requests whose path begins with /api/ (protocol.md).
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include "formats/session/telemetry.h"
#include "runtime/console/access.h"
#include "runtime/console/server.h"
#include "runtime/console/session_telemetry.h"

namespace trocar::runtime {

// Encodes the messages to clients (protocol.md): events as JSON with a text for the operator, ticks
// and meshes as bytes. A binary message begins with its kind and its number. The functions
// below encode only the contents that follow; TelemetryClient sends kind and number before them.

/// Returns one event as a JSON object, for the list in the message `events`.
std::string event_message(const TelemetryEvent& event);

/// Returns the contents of a message of kind 1 (snapshot: the values of one tick).
std::string snapshot_message(const std::vector<double>& values);

/// Returns the contents of a message of kind 4 (history of the force).
std::string history_message(const std::vector<ForceHistory::Point>& points);

/// Returns the contents of a message of kind 2 (a sheet with its holes, two floats per vertex) or
/// of kind 3 (shape: the deformed sheet around the tool, three floats per vertex). `sheet`: index
/// of the sheet. `cuts`: number of its holes. `slice`: its slice index. `hu`: one value for each
/// vertex; empty: none.
std::string mesh_message(std::int32_t sheet, std::uint32_t cuts, std::int32_t slice,
                         const std::vector<float>& positions, std::size_t floats_of_vertex,
                         const std::vector<float>& hu, const std::vector<std::uint32_t>& triangles);

// Answers the requests whose path begins with /api/ (protocol.md). Precondition: the caller has
// checked the request's Host, Origin and token. This code does not use sockets.

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
