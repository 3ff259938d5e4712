// SPDX-License-Identifier: Apache-2.0
// One HTTP connection: reads requests one after the other, checks whether they may be answered, and
// sends the answers.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "runtime/console/api.h"
#include "runtime/console/beast.h"
#include "runtime/console/console_state.h"

namespace trocar::runtime {

class HttpConnection : public std::enable_shared_from_this<HttpConnection> {
 public:
  HttpConnection(ConsoleState& console, tcp::socket socket, std::string from);
  /// Reads and answers one request after the other until the connection ends.
  void read();
  /// True while the connection waits for a request, or for its end. When a client connects and there
  /// are already 64 connections, the server closes an idle one, or if there is none, one without a
  /// valid token.
  bool is_idle() const noexcept { return is_idle_; }
  bool has_shown_token() const noexcept { return has_shown_token_; }
  void close();

 private:
  void on_error(beast::error_code error);
  /// Logs a refused request, answers with `status`, and closes the connection.
  void refuse(unsigned status, const char* kind);
  void refuse_host(const Request& request);
  void answer(const Request& request);
  void answer_file(const std::string& path, bool is_get);
  /// Runs `work` on the worker thread, and then sends the answer that `work` returned.
  void later(std::function<Answer()> work);
  void send(Answer answer);
  void drain();
  void open_client(const Request& request);

  ConsoleState& console_;
  beast::tcp_stream stream_;
  std::string from_;
  beast::flat_buffer buffer_;
  std::optional<http::request_parser<http::string_body>> parser_;
  unsigned version_ = 11;
  bool keep_ = false, is_idle_ = true, has_shown_token_ = false;
  int drained_ = 0;
};

}  // namespace trocar::runtime
