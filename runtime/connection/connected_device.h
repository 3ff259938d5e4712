// SPDX-License-Identifier: Apache-2.0
// Makes a pose device of a connection whose calls may wait. A separate thread exchanges wrench and pose with the
// connection again and again. The haptic thread takes the newest pose and leaves its wrench, without ever waiting.
//
// Contract (tests/runtime/connection/connected_device_test.cpp):
//  1. read() and write() do not allocate, lock or wait, whatever the connection does.
//  2. If the haptic thread has written nothing for kStaleCommand_s, the connection gets zero force until
//     it writes again.
//  3. After an error of the connection, read() returns kLinkLost, and the error is reported in one line. restore()
//     makes the thread connect again. The first wrench after that is zero.
//  4. The round trip of a wrench is the time from its write() to the read() of the first pose that the connection
//     returned for it.
//  5. close() ends with zero force. It waits for a call that is in progress, at most for the connection's
//     own time limits.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>

#include "formats/base/result.h"
#include "runtime/connection/pose_connection.h"
#include "runtime/device/pose_device.h"
#include "runtime/realtime/histogram.h"
#include "runtime/realtime/triple_buffer.h"

namespace trocar::runtime {

/// Age of the last write() from which on the connection gets zero force.
inline constexpr double kStaleCommand_s = 0.01;

/// Realtime priority of the connection's thread, if the process may set one. It is below that of the
/// haptic thread.
inline constexpr int kConnectionPriority = 75;

class ConnectedDevice final : public PoseDevice {
 public:
  /// `period_s`: shortest time from one exchange to the next. `say` receives each error while the session runs. It
  /// is called on the connection's thread.
  ConnectedDevice(std::unique_ptr<PoseConnection> connection, double period_s, SayLine say);
  ~ConnectedDevice() override;

  /// Opens the connection. Blocks up to kOpenTimeout_s. Errors: those of PoseConnection::open().
  Result<void> start() override;
  DeviceStatus read(PoseReading& reading) noexcept override;
  DeviceStatus write(const HandleWrench& wrench) noexcept override;
  void restore() noexcept override;
  void close() override;
  /// Sessions and round trips, after close().
  std::optional<LinkReport> link_report() const override;

 private:
  enum class State : std::uint8_t { kConnected, kLost, kRestoring };
  struct Command {
    HandleWrench wrench{};
    std::int64_t at_ns = 0;
  };
  struct Answer {
    PoseReading reading;
    std::int64_t command_ns = 0;  ///< Command::at_ns of the command that it answers; 0: none
  };
  void run();
  void exchange_once();
  void lose(const Error& error);

  std::unique_ptr<PoseConnection> connection_;
  std::int64_t period_ns_;
  SayLine say_;
  TripleBuffer<Answer> answers_;
  TripleBuffer<Command> commands_;
  std::atomic<State> state_{State::kLost};
  std::atomic<bool> closing_{false};
  std::thread thread_;
  // The following two members belong to the haptic thread.
  Histogram round_trip_;
  std::int64_t last_answered_ns_ = 0;  ///< Answer::command_ns whose round trip was counted last
  // The following members belong to the connection's thread.
  Command command_;
  std::uint64_t sessions_ = 0;
  std::string
      said_;  ///< the last error, which is not repeated while restoring fails for the same reason
};

}  // namespace trocar::runtime
