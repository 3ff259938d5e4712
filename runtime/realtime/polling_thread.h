// SPDX-License-Identifier: Apache-2.0
// A background thread that calls a function again and again, and sleeps for a fixed interval after
// each call. The function checks whether the haptic thread has left work to do. The haptic thread
// does not wake the background thread, because that would need a system call.
#pragma once

#include <chrono>
#include <functional>
#include <stop_token>
#include <thread>
#include <utility>

namespace trocar::runtime {

class PollingThread {
 public:
  /// Starts the thread. Until stop(), the thread calls `serve` and sleeps for `interval`, in turn.
  void start(std::chrono::nanoseconds interval, std::function<void()> serve) {
    thread_ = std::jthread([interval, serve = std::move(serve)](const std::stop_token& stop) {
      while (!stop.stop_requested()) {
        serve();
        std::this_thread::sleep_for(interval);
      }
    });
  }
  /// Ends the thread and waits until it has ended. Does nothing if the thread was not started. Work
  /// that arrived after the last call of `serve` is not done; the caller can do it after stop().
  void stop() { thread_ = {}; }

 private:
  std::jthread thread_;
};

}  // namespace trocar::runtime
