// SPDX-License-Identifier: Apache-2.0
// A separate thread for calls of a foreign library that may never return. The caller waits for each call up to a
// limit, and then continues without the result. The thread makes all calls, one after the other, because libraries
// keep state for each thread, such as the last error.
// Tests: tests/runtime/connection/call_thread_test.cpp
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <thread>
#include <type_traits>
#include <utility>

namespace trocar::runtime {

/// One thread makes all calls of a CallThread. A call must own everything that it uses (captured by value, or as a
/// shared pointer), because it may still run after the caller has stopped waiting and the CallThread is destroyed.
class CallThread {
 public:
  CallThread();
  /// Waits at most `kPatience_s` for a call that has not returned. If it still does not return, its thread
  /// is left running.
  ~CallThread();
  CallThread(const CallThread&) = delete;
  CallThread& operator=(const CallThread&) = delete;

  /// Makes a call and returns its result. Returns nothing if there is no result within `timeout_s`. In that case
  /// either the call is still running, or it was never begun because an earlier call is still running.
  template <typename Call>
  std::optional<std::invoke_result_t<Call>> call(Call function, double timeout_s) {
    auto result = std::make_shared<std::optional<std::invoke_result_t<Call>>>();
    if (!run([result, function] { result->emplace(function()); }, timeout_s)) return std::nullopt;
    return std::move(*result);
  }

  /// Makes a call, and waits for it at most `kPatience_s`. If an earlier call is still running, this call is made
  /// as soon as the earlier one has returned, however late. Only the latest waiting call is kept.
  void call_at_last(std::function<void()> function);

  static constexpr double kPatience_s = 0.1;
  /// Realtime priority of the thread, if the process may set one. It is above that of the thread that waits
  /// for its calls.
  static constexpr int kPriority = 76;

 private:
  struct Shared;
  bool run(std::function<void()> function, double timeout_s);
  static void serve(const std::shared_ptr<Shared>& shared);

  std::shared_ptr<Shared>
      shared_;  ///< owned together with the thread, which may outlive this object
  std::thread thread_;
};

}  // namespace trocar::runtime
