// SPDX-License-Identifier: Apache-2.0
// A separate thread for calls into a foreign library. Because a call may never return, the caller
// waits for it only up to a time limit, and then continues without the result. One thread makes all
// calls, one after the other, because a library may store data per thread, such as the last error.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <thread>
#include <type_traits>
#include <utility>

namespace trocar::runtime {

/// Precondition: every function that is passed to a CallThread owns everything that it uses
/// (captured by value, or as a shared pointer). The function may still run after the caller has
/// stopped waiting and the CallThread is destroyed.
class CallThread {
 public:
  CallThread();
  /// If a call is still running, waits for it at most `kPatience_s`. If the call has not returned
  /// by then, the thread continues to run after the CallThread is destroyed.
  ~CallThread();
  CallThread(const CallThread&) = delete;
  CallThread& operator=(const CallThread&) = delete;

  /// Calls `function` on the thread and returns its result. Returns nullopt if there is no result
  /// within `timeout_s`. In this case either `function` is still running, or `function` will never
  /// be called because an earlier call has not returned in time.
  template <typename Call>
  std::optional<std::invoke_result_t<Call>> call(Call function, double timeout_s) {
    auto result = std::make_shared<std::optional<std::invoke_result_t<Call>>>();
    if (!run([result, function] { result->emplace(function()); }, timeout_s)) return std::nullopt;
    return std::move(*result);
  }

  /// Calls `function` on the thread, and waits at most `kPatience_s` for the function's end. If an
  /// earlier call is still running, `function` is called as soon as the earlier call has returned,
  /// however late. If call_at_last() is called again before that, only the latest function is
  /// called. Use this for a last command, such as zero force.
  void call_at_last(std::function<void()> function);

  static constexpr double kPatience_s = 0.1;
  /// Realtime priority of the thread, if the process may set one. It is above the priority of the
  /// thread that waits for the calls (connected_device.h).
  static constexpr int kPriority = 76;

 private:
  struct Shared;
  bool run(std::function<void()> function, double timeout_s);
  static void serve(const std::shared_ptr<Shared>& shared);

  std::shared_ptr<Shared>
      shared_;  ///< also owned by the thread, because the thread may outlive this object
  std::thread thread_;
};

}  // namespace trocar::runtime
