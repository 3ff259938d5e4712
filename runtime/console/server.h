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
  /// Address with which the printed links begin: a result of public_url_of(). If empty, the links
  /// begin with the address on which the console listens.
  std::string public_url;
  /// The scene of --start, as JSON for /api/folder, or empty if there is none. The page starts a
  /// session with this scene.
  std::string start;
  std::string playback;  ///< the files of a playback, as JSON for /api/folder; empty: no playback
  /// Address for OpenIGTLink clients. If nullopt, they are not served.
  std::optional<IgtlAddress> igtl;
};

/// Prints the links and serves until SIGINT, SIGTERM or SIGHUP. Then ends the programs that the
/// console runs (Supervisor::end_all()) and returns. Errors: kUsage if ServerSettings::listen is
/// not numerical; kUnwritable if the server cannot listen on an address.
Result<void> serve(const ServerSettings& settings, Files files, PageFiles page);

}  // namespace trocar::runtime
