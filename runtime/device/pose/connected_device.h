// SPDX-License-Identifier: Apache-2.0
// Pose devices behind a maker's library or service, whose calls may block.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <type_traits>
#include <utility>

#include "formats/base/result.h"
#include "runtime/device/device.h"
#include "runtime/device/pose_device.h"
#include "runtime/realtime/histogram.h"
#include "runtime/realtime/queues.h"

namespace trocar::runtime {

// Cleans a text from a device or a library, so that it can stand in one line of a message.

/// Returns `text` with "?" in place of each character that is not printable ASCII. If the text has
/// more than `max_chars` characters, the rest is replaced by "...". An empty text becomes
/// "(no text)".
inline std::string foreign_text(std::string_view text, std::size_t max_chars = 300) {
  if (text.empty()) return "(no text)";
  std::string line(text.substr(0, max_chars));
  for (char& c : line)
    c = c >= ' ' && c <= '~' ? c : '?';
  if (text.size() > max_chars) line += "...";
  return line;
}

/// Like the function above, for a null-terminated text. A null pointer is treated as an empty text.
inline std::string foreign_text(const char* text) {
  return foreign_text(text == nullptr ? std::string_view() : std::string_view(text));
}

// A separate thread for calls into a foreign library. Because a call may never return, the caller
// waits for it only up to a time limit, and then continues without the result. One thread makes all
// calls, one after the other, because a library may store data per thread, such as the last error.

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

// A connection to a device through a maker's SDK or service, whose calls may block. ConnectedDevice
// (connected_device.h) turns a connection into a PoseDevice: it makes the exchanges on a separate
// thread. An implementation of PoseConnection may therefore allocate, lock and block, and needs no
// thread of its own.

/// Longest time that exchange() may take. If the device is silent for longer, exchange() returns an
/// error.
inline constexpr double kExchangeTimeout_s = 0.1;
/// Longest time that open() may take.
inline constexpr double kOpenTimeout_s = 5;

/// Receives one line for the operator, such as "haply:localhost:10001: a second device was found;
/// the first one is used".
using SayLine = std::function<void(const std::string& line)>;

/// The caller calls open(), then exchange() repeatedly, then close(), and possibly open() again.
/// Different threads may make these calls, but never two at the same time.
class PoseConnection {
 public:
  virtual ~PoseConnection() = default;

  /// Connects, finds the device and commands zero force. After a first success, every later call
  /// must find the same device again. Errors: kDeviceFault. The message is one clear line that
  /// begins with the device's URI and says what the user can do. After an error the caller may call
  /// only close() or open().
  virtual Result<void> open() = 0;
  /// Commands the wrench and returns the newest reading of the device. The times of readings do not
  /// descend; a reading with the time of the one before is the same measurement, given again. The
  /// implementation does not trust data from the device: it checks sizes, types and numbers. An
  /// unusable message from the device need not be an error: the implementation may wait for the
  /// next message, as long as exchange() ends within kExchangeTimeout_s. Errors: kDeviceFault, with
  /// a message of one clear line. After an error the caller must call close().
  virtual Result<PoseReading> exchange(const HandleWrench& wrench) = 0;
  /// After an exchange() that returned an error: kRefusedState with the field, if a message of the
  /// device was refused because of its contents. Otherwise no fault.
  virtual FaultDetail refused_contents() const noexcept { return {}; }
  /// Commands zero force if the connection still exists, and disconnects. Also allowed after an
  /// error.
  virtual void close() noexcept = 0;
};

// Turns a connection whose calls may block into a pose device. A separate
// thread makes one exchange after another: an exchange sends a wrench to the device and returns the
// device's pose. The haptic thread reads the newest pose, and stores the wrench that the next
// exchange will send. The haptic thread never waits for the connection.
//
// Contract:
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
