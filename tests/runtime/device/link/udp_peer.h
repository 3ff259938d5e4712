// SPDX-License-Identifier: Apache-2.0
// A drive on a socket of this machine, and the loop's side that connects to it: for the tests of
// UdpDevice.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <span>
#include <thread>
#include <utility>

#include "runtime/device/link/link_key.h"
#include "runtime/device/link/udp_link.h"
#include "runtime/device/simulated/drive.h"

namespace trocar::runtime::testing_support {

inline SimulatedDevice held_device() {
  HandTrajectory hand;
  hand.keyframes.resize(1);
  hand.keyframes[0].T_device_tool.p_m.z() = 0.15;
  return std::move(*SimulatedDevice::make(default_device_description(), hand, {}));
}

inline std::int64_t now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}
inline void sleep_ms(int ms) {
  std::this_thread::sleep_for(std::chrono::milliseconds(ms));
}

/// A drive on a socket, run by a thread: states every millisecond (whatever period it states), or
/// in lock-step.
class Peer {
 public:
  /// The watchdog's time is long, so that a short stall of this machine does not trip it.
  explicit Peer(LinkClock clock, const char* faults = "", double watchdog_s = 10,
                double period_s = 1e-3)
      : Peer(clock, faults, watchdog_s, {0x7f000001, 0}, random_link_key(), period_s) {}
  /// A drive that was restarted: it has the key and the address of the previous one.
  Peer(LinkClock clock, const char* faults, double watchdog_s, const Endpoint& at,
       const LinkKey& with, double period_s = 1e-3)
      : socket_(std::move(*UdpSocket::listen(at))), key(with) {
    DriveOptions options;
    options.key = key;
    options.clock = clock;
    options.period_s = period_s;
    options.watchdog_s = watchdog_s;
    options.session_s = 1000;
    options.faults = *parse_fault_plan(faults);
    endpoint = socket_.local();
    thread_ = std::thread([this, options] { serve(options); });
  }
  ~Peer() {
    done_ = true;
    thread_.join();
  }
  Peer(const Peer&) = delete;
  Peer& operator=(const Peer&) = delete;

  /// While set, no states are sent; commands are received.
  std::atomic<bool> mute{false};
  /// While set, commands are received only after 100 ms.
  std::atomic<bool> is_slow{false};
  /// Datagrams received.
  std::atomic<int> received{0};
  /// Waits until `count` more states have been sent, however long this machine takes for them.
  void wait_for_states(int count) const {
    for (const int until = sent_ + count; sent_ < until;)
      sleep_ms(1);
  }

 private:
  UdpSocket socket_;

 public:
  LinkKey key;
  Endpoint endpoint;

 private:
  void serve(const DriveOptions& options) {
    Drive drive(options, held_device());
    Endpoint host;
    while (!done_) {
      if (socket_.wait(1e-3) && is_slow) sleep_ms(100);
      std::array<std::uint8_t, 512> buffer;
      std::size_t bytes = 0;
      Endpoint from;
      Drive::Answer answer;
      while (socket_.receive(buffer, bytes, from) == UdpSocket::Outcome::kDone) {
        ++received;
        bool from_host = false;
        drive.receive(std::span(buffer).first(std::min<std::size_t>(bytes, 512)), now_ns(), answer,
                      from_host);
        if (from_host) host = from;
        if (answer.size > 0) socket_.send_to(answer.view(), from);
      }
      if (options.clock == LinkClock::kLockStep) continue;
      drive.tick(now_ns(), 1, answer);
      if (answer.size == 0 || mute) continue;
      socket_.send_to(answer.view(), host);
      ++sent_;
    }
  }
  std::atomic<int> sent_{0};
  std::atomic<bool> done_{false};
  std::thread thread_;
};

inline UdpLinkOptions to(const Peer& peer, LinkClock clock = LinkClock::kReal) {
  UdpLinkOptions options;
  options.peer = peer.endpoint;
  options.key = peer.key;
  options.clock = clock;
  options.connect_timeout_s = 5;
  options.no_state_s = 5;  // longer than this machine ever stalls
  return options;
}

inline Result<std::unique_ptr<UdpDevice>> connect(const UdpLinkOptions& options) {
  Result<std::unique_ptr<UdpDevice>> device = UdpDevice::make(options);
  if (!device) return device;
  if (Result<void> started = (*device)->start(); !started) return started.error();
  return device;
}

inline std::unique_ptr<UdpDevice> connected(const UdpLinkOptions& options) {
  auto device = connect(options);
  EXPECT_TRUE(device) << device.error().message;
  return device ? std::move(*device) : nullptr;
}

/// Reads until the status is not kNoData, for at most two seconds.
inline DeviceStatus next(UdpDevice& device, DeviceState& state) {
  for (int ms = 0; ms < 2000; ++ms) {
    const DeviceStatus status = device.read(state);
    if (status != DeviceStatus::kNoData) return status;
    sleep_ms(1);
  }
  return DeviceStatus::kNoData;
}

}  // namespace trocar::runtime::testing_support
