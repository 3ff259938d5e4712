// SPDX-License-Identifier: Apache-2.0
// A background thread that calls a function again and again, and sleeps for a fixed interval after
// each call. Worker threads poll, because the haptic thread would need a system call to wake them.
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

  /// Starts the thread. It calls `serve` and then sleeps for `interval`, repeatedly until stop().
  void start(std::chrono::nanoseconds interval, std::function<void()> serve) {
    stopping_.store(false);
    thread_ = std::thread([this, interval, serve = std::move(serve)] {
      while (!stopping_.load(std::memory_order_acquire)) {
        serve();
        std::this_thread::sleep_for(interval);
      }
    });
  }
  /// Ends the thread and waits for it; does nothing if it was not started. Work that arrived after
  /// the last call of `serve` is left to the caller.
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
