// SPDX-License-Identifier: Apache-2.0
// The state that all connections of one console share. Only the network thread uses this state,
// except for two parts: only the worker thread uses the members `bone` and `volume`, and only the
// worker thread calls Files::list().
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "runtime/console/access.h"
#include "runtime/console/files.h"
#include "runtime/console/page_files.h"
#include "runtime/console/server.h"
#include "runtime/console/supervisor.h"

namespace trocar::runtime {

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
