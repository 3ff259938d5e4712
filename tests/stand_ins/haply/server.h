// SPDX-License-Identifier: Apache-2.0
// The sockets of the stand-in: HTTP and WebSocket on one port of this machine's loopback.
#pragma once

#include <cstdint>
#include <optional>

#include "tests/stand_ins/haply/service.h"

namespace trocar::haply_stand_in {

/// Prints "listening on PORT" and serves until SIGINT, SIGTERM or the end of `duration_s`. Port 0: any free one. Throws
/// std::runtime_error with one line if the port cannot be used.
void serve(Service& service, std::uint16_t port, std::optional<double> duration_s);

}  // namespace trocar::haply_stand_in
