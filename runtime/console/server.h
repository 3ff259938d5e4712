// SPDX-License-Identifier: Apache-2.0
// The console's HTTP and WebSocket server (protocol.md).
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
  /// Address of the tunnel or proxy through which browsers reach the console, a result of
  /// public_url_of(). The printed links begin with this address. If it is empty, they begin with
  /// the address on which the console listens.
  std::string public_url;
  /// The scene of the option --start, with which the page starts a session; empty: none. It is a
  /// file name as JSON text, which the answer of /api/folder contains.
  std::string start;
  /// The file names of a playback, as JSON text, which the answer of /api/folder contains. If the
  /// text is empty, there is no playback.
  std::string playback;
  /// Address for OpenIGTLink clients. If nullopt, they are not served.
  std::optional<IgtlAddress> igtl;
};

/// Prints a link with a token for the operator and one for the audience, and serves until SIGINT,
/// SIGTERM or SIGHUP. Then ends the programs that the console runs (Supervisor::end_all()) and
/// returns. Errors: kUsage if ServerSettings::listen is not numerical; kUnwritable if the server
/// cannot listen on an address.
Result<void> serve(const ServerSettings& settings, Files files, PageFiles page);

}  // namespace trocar::runtime
