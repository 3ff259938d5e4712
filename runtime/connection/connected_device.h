// SPDX-License-Identifier: Apache-2.0
// Turns a connection whose calls may block (pose_connection.h) into a pose device. A separate
// thread makes one exchange after another: an exchange sends a wrench to the device and returns the
// device's pose. The haptic thread reads the newest pose, and stores the wrench that the next
// exchange will send. The haptic thread never waits for the connection.
//
// Contract (tests/runtime/connection/connected_device_test.cpp):
//  1. read() and write() do not allocate, lock or block, whatever the connection does.
//  2. If the last write() is at least kStaleCommand_s or kStalePeriods periods old, whichever is
//     longer, exchanges send zero force until the haptic thread calls write() again.
//  3. After an error of the connection, read() returns kLinkLost, and `say` receives the error in
//     one line. restore() makes the connection's thread connect again. Wrenches that were written
//     before the new connection exists are not sent, and read() does not return older poses.
//  4. The round trip of a wrench begins with the write() of this wrench. It ends with the first
//     read() that returns the pose of an exchange that sent this wrench.
//  5. close() commands zero force at the end. If a call of the connection is in progress, close()
//     first waits until the call returns. The connection's own time limits bound this wait.
//  6. If the connection returns the same measurement several times (poses with the same time),
//     read() returns the measurement once, and then kNoData.
#pragma once

#include <atomic>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <thread>

#include "formats/base/result.h"
#include "runtime/connection/pose_connection.h"
#include "runtime/device/pose_device.h"
#include "runtime/device/refused_contents.h"
#include "runtime/realtime/histogram.h"
#include "runtime/realtime/triple_buffer.h"

namespace trocar::runtime {

/// A wrench that was written this long ago, or longer, is no longer sent. Exchanges send
/// zero force instead.
inline constexpr double kStaleCommand_s = 0.01;
/// If the periods are long, a wrench is no longer sent after this number of periods. A loop that
/// writes in every second period, and is sometimes late, must not be cut off.
inline constexpr double kStalePeriods = 5;

/// Realtime priority of the connection's thread, if the process may set one. It is below the
/// priority of the haptic thread.
inline constexpr int kConnectionPriority = 75;

class ConnectedDevice final : public PoseDevice {
 public:
  /// `period_s`: shortest time from the start of an exchange to the start of the next. `say`
  /// receives each error that occurs after start(), but a repeated error only once. The
  /// connection's thread calls `say`.
  ConnectedDevice(std::unique_ptr<PoseConnection> connection, double period_s, SayLine say);
  ~ConnectedDevice() override;

  /// Opens the connection and starts its thread. Blocks up to kOpenTimeout_s. Errors: those of
  /// PoseConnection::open(); kBug if start() was called before.
  Result<void> start() override;
  DeviceStatus read(PoseReading& reading) noexcept override;
  DeviceStatus write(const HandleWrench& wrench) noexcept override;
  FaultDetail refused_contents() const noexcept override { return refused_.get(); }
  void restore() noexcept override;
  void close() override;
  /// Returns the number of connections that were established, and the histogram of the round trips
  /// (contract 4). Call this only after close().
  std::optional<LinkReport> link_report() const override;

 private:
  enum class State : std::uint8_t { kConnected, kLost, kRestoring };
  struct Command {
    HandleWrench wrench{};
    std::int64_t at_ns = 0;
  };
  struct Answer {
    PoseReading reading;
    /// Command::at_ns of the wrench that was sent. 0: the last wrench was too old, so the exchange
    /// sent zero force.
    std::int64_t command_ns = 0;
  };
  void run();
  void exchange_once();
  void lose(const Error& error);

  std::unique_ptr<PoseConnection> connection_;
  std::int64_t period_ns_;
  double stale_s_;  ///< age from which on a wrench is no longer sent
  SayLine say_;
  TripleBuffer<Answer> answers_;
  TripleBuffer<Command> commands_;
  std::atomic<State> state_{State::kLost};
  std::atomic<bool> closing_{false};
  RefusedContents refused_;
  std::thread thread_;
  // The following three members belong to the haptic thread.
  Histogram round_trip_;
  /// Answer::command_ns of the last round trip that was counted.
  std::int64_t last_answered_ns_ = 0;
  /// Time of the last pose that read() returned; nan before the first one.
  double last_t_s_ = std::numeric_limits<double>::quiet_NaN();
  // The following members belong to the connection's thread.
  Command command_;
  std::uint64_t sessions_ = 0;
  /// The last reported error. While attempts to restore fail for the same reason, the error is not
  /// reported again.
  std::string said_;
};

}  // namespace trocar::runtime
