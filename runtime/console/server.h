// SPDX-License-Identifier: Apache-2.0
// The console's HTTP and WebSocket server (protocol.md).
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "formats/base/result.h"
#include "runtime/console/access.h"
#include "runtime/console/files.h"
#include "runtime/console/igtl.h"
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

// The state that all connections of one console share. Only the network thread uses this state,
// except for two parts: only the worker thread uses the members `bone` and `volume`, and only the
// worker thread calls Files::list().

/// Reports refused requests on stderr, each kind of refusal only once.
class RefusalLog {
 public:
  void refused(const char* kind, const std::string& from);
  /// Reports an emergency stop. Prints at most one line in 10 s.
  void emergency_stop(const std::string& from);

 private:
  std::set<std::string> reported_;
  std::optional<std::chrono::steady_clock::time_point> last_stop_;
};

/// Keeps the answer to one request, because all pages of a session ask for the same bone.
/// ConsoleState has two caches: one for the last request for a bone, and one for the last request
/// for a volume of HU.
struct BoneCache {
  std::string key;  ///< names and modification times of the answer's source files
  std::shared_ptr<const std::string> answer;
};

class HttpConnection;
class TelemetryClient;

struct ConsoleState {
  ConsoleState(boost::asio::io_context& io, const ServerSettings& its_settings, Files its_files,
               PageFiles its_page, HostNames its_hosts)
      : context(io),
        settings(its_settings),
        files(std::move(its_files)),
        page(std::move(its_page)),
        hosts(std::move(its_hosts)),
        supervisor(its_settings.session) {}

  boost::asio::io_context& context;
  const ServerSettings& settings;
  Files files;
  PageFiles page;
  HostNames hosts;
  Tokens tokens;
  Supervisor supervisor;
  HandHolder hand;
  RefusalLog log;
  std::vector<std::weak_ptr<HttpConnection>> connections;
  std::vector<std::weak_ptr<TelemetryClient>> clients;
  std::function<void()> poll_soon;  ///< makes the server call Supervisor::poll() immediately
  bool has_new_snapshot = false;    ///< the last Supervisor::poll() has read a new snapshot
  /// The worker thread reads files of any size, so that reading them never delays live data.
  boost::asio::thread_pool worker{1};
  BoneCache bone, volume;
};

/// Removes the connections that have ended. Returns the number of connections that remain.
template <typename T>
std::size_t count_living(std::vector<std::weak_ptr<T>>& all) {
  std::erase_if(all, [](const auto& one) { return one.expired(); });
  return all.size();
}

}  // namespace trocar::runtime
