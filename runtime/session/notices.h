// SPDX-License-Identifier: Apache-2.0
// What the operator must be told while a session runs: a fault, why a recovery is not granted yet,
// a recovery. The haptic thread pushes records of fixed size; another thread finds the words and
// calls the program's function, at once.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <thread>

#include "formats/session/fault_words.h"
#include "runtime/realtime/spsc_queue.h"

namespace trocar::runtime {

struct Notice {
  enum class Kind : std::uint8_t {
    kFault,         ///< `detail` was latched
    kNotRecovered,  ///< recovery was asked for, and `detail` or the tool in material prevents it
    kRecovered,     ///< from `detail`, of which only the fault is set
  };
  Kind kind = Kind::kFault;
  double t_s = 0;
  FaultDetail detail;
  double lift_m = 0;  ///< kNotRecovered: above 0, the tool is so deep in material
};

/// One line without the program's name.
std::string describe(const Notice& notice);

class Notices {
 public:
  /// `tell` is called on the thread that start() creates, or on that of serve().
  explicit Notices(std::function<void(const Notice&)> tell) : tell_(std::move(tell)) {}
  ~Notices() { stop(); }
  Notices(const Notices&) = delete;
  Notices& operator=(const Notices&) = delete;

  /// Haptic thread. Lost if kCapacity notices wait; the summary has every fault all the same.
  void push(const Notice& notice) noexcept { waiting_.push(notice); }

  void start();
  /// Tells what waits.
  void serve();
  /// Ends the thread, if any, and tells what still waits.
  void stop();

 private:
  static constexpr std::size_t kCapacity = 64;
  SpscQueue<Notice, kCapacity> waiting_;
  std::thread thread_;
  std::function<void(const Notice&)> tell_;
  std::atomic<bool> stopping_{false};
};

/// Decides in each tick whether a recovery that was asked for is held up by something that the
/// operator was not told yet: once per reason and fault.
class RecoveryWatch {
 public:
  /// Reasons that last less than this after the request are not worth a line.
  static constexpr double kPatience_s = 0.1;

  void fault_latched() noexcept { *this = {}; }
  /// `waiting`: recovery was asked for, and `running` has not begun. True: tell the reason.
  bool tells(bool waiting, double t_s, const FaultDetail& found, double lift_m) noexcept;

 private:
  double asked_t_s_ = -1;
  std::uint64_t told_ = 0;  ///< a bit for each fault, and one for the tool in material
};

}  // namespace trocar::runtime
