// SPDX-License-Identifier: Apache-2.0
// The console's HTTP and WebSocket server (protocol.md).
// Tests: tests/e2e/console_server_test.py, tests/e2e/console_hostile_test.py
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "formats/base/result.h"
#include "runtime/console/files.h"
#include "runtime/console/igtl/igtl_address.h"
#include "runtime/console/page_files.h"
#include "runtime/console/supervisor.h"

namespace trocar::runtime {

struct ServerSettings {
  std::string listen = "127.0.0.1";  ///< numerical address on which the server listens
  std::uint16_t port = 0;            ///< 0: any free port
  Supervisor::Settings session;
  /// Address with which the printed links begin: a result of public_url_of(). Empty: the links
  /// begin with the address on which the console listens.
  std::string public_url;
  std::string start;     ///< JSON for `start` of /api/folder, the name of a scene; empty: none
  std::string playback;  ///< JSON for `playback` of /api/folder; empty: none
  std::optional<IgtlAddress> igtl;  ///< address for OpenIGTLink clients; none: they are not served
};

/// Prints the links, serves until SIGINT, SIGTERM or SIGHUP, and then ends what the console runs
/// (Supervisor::end_all()). Errors: kUsage if the address is not numerical; kUnwritable if the
/// server cannot listen on the address.
Result<void> serve(const ServerSettings& settings, Files files, PageFiles page);

}  // namespace trocar::runtime
