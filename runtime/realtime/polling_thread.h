// SPDX-License-Identifier: Apache-2.0
// A background thread that calls a function again and again, and sleeps for a fixed interval after
// each call. The function checks whether the haptic thread has left work to do. The haptic thread
// does not wake the background thread, because that would need a system call.
// Tests: tests/runtime/telemetry/black_box_test.cpp
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <thread>
#include <utility>

namespace trocar::runtime {

class PollingThread {
 public:
  PollingThread() = default;
  ~PollingThread() { stop(); }
  PollingThread(const PollingThread&) = delete;
  PollingThread& operator=(const PollingThread&) = delete;

  /// Starts the thread. Until stop(), the thread calls `serve` and sleeps for `interval`, in turn.
  void start(std::chrono::nanoseconds interval, std::function<void()> serve) {
    stopping_.store(false);
    thread_ = std::thread([this, interval, serve = std::move(serve)] {
      while (!stopping_.load(std::memory_order_acquire)) {
        serve();
        std::this_thread::sleep_for(interval);
      }
    });
  }
  /// Ends the thread and waits until it has ended. Does nothing if the thread was not started. Work
  /// that arrived after the last call of `serve` is not done; the caller can do it after stop().
  void stop() {
    if (!thread_.joinable()) return;
    stopping_.store(true, std::memory_order_release);
    thread_.join();
  }

 private:
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace trocar::runtime
