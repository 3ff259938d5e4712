// SPDX-License-Identifier: Apache-2.0
// Faults to inject into a simulated drive and its link, each with kind, time and probability.
// Random choices are seeded, so the same plan, seed and packets give the same faults.
//
// A plan is a text of items separated by commas. Each item has the form
// KIND[:VALUE[:VALUE]][@FROM[..TO]]. The fault begins at FROM (default: 0) and ends at TO (default:
// never). Times are simulated times in s. They begin at 0 in each session that resets the simulated
// world, but continue if a lost link is restored.
//   loss:P             packets are lost
//   delay:P:MS         packets are delayed by MS ms
//   duplicate:P        packets are delivered twice
//   reorder:P          packets are delivered after the next packet, at the latest after 20 ms
//   flip:P             one bit of a packet is inverted
//   stuck:ENCODER      an encoder, 0 to 15, keeps its angle
//   jump:ENCODER:RAD   RAD is added to the angle of an encoder, 0 to 15, in rad
//   dead:MOTOR         a motor, 0 to 7, applies no torque
//   stop               the emergency stop is pressed
//   kill               the process that simulates the drive is killed
// P is the probability with which the fault concerns a packet. Faults of packets concern both
// commands and states. If "command-" or "state-" stands before the kind, the fault concerns only
// commands or only states.
// Example: loss:0.01,state-loss:1@2.5..2.6,jump:4:0.2@3,stop@4
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <random>
#include <span>
#include <string_view>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/device_protocol.h"
#include "runtime/link/udp_socket.h"

namespace trocar::runtime {

enum class FaultKind : std::uint8_t {
  kLoss,
  kDelay,
  kDuplicate,
  kReorder,
  kFlip,
  kStuck,
  kJump,
  kDead,
  kStop,
  kKill,
};
enum class LinkDirection : std::uint8_t { kCommands, kStates };

struct PlannedFault {
  FaultKind kind = FaultKind::kLoss;
  bool on_commands = true, on_states = true;  ///< directions of a packet fault
  double probability = 1;                     ///< probability of a packet fault
  double delay_s = 0;
  int channel = 0;  ///< encoder or motor
  double jump_rad = 0;
  double from_s = 0, to_s = std::numeric_limits<double>::infinity();  ///< active in [from_s, to_s)
  bool is_on(double t_s) const noexcept { return t_s >= from_s && t_s < to_s; }
};
using FaultPlan = std::vector<PlannedFault>;

/// Parses a plan. An empty text gives an empty plan. Errors: kUsage; the message quotes the item
/// that is wrong.
Result<FaultPlan> parse_fault_plan(std::string_view text);

/// One direction of a link with faults. The link holds back at most kHeld packets that are delayed
/// or reordered; further such packets are lost.
class FaultyLink {
 public:
  static constexpr std::size_t kHeld = 64;
  struct Datagram {
    std::array<std::uint8_t, 512> bytes{};
    std::size_t size = 0;  ///< size of the datagram, at most bytes.size()
    Endpoint peer;
    std::span<const std::uint8_t> view() const noexcept { return {bytes.data(), size}; }
  };

  FaultyLink(const FaultPlan& plan, LinkDirection way, std::uint64_t seed);

  /// Sends `datagram` over the link. Calls `deliver` with each datagram that arrives now.
  /// Because of faults, `datagram` may arrive once, several times, changed, later or never.
  /// `t_s`: the simulated time; `now_ns`: the time of a monotonic clock.
  template <typename Deliver>
  void pass(const Datagram& datagram, double t_s, std::int64_t now_ns, Deliver&& deliver) {
    Datagram changed = datagram;
    const int copies = decide(changed, t_s, now_ns);
    for (int i = 0; i < copies; ++i)
      deliver(changed);
    // This datagram has overtaken the datagrams that wait to be overtaken.
    if (copies > 0) release(now_ns, true, deliver);
  }
  /// Calls `deliver` with each delayed or reordered datagram that is due.
  template <typename Deliver>
  void release_due(std::int64_t now_ns, Deliver&& deliver) {
    release(now_ns, false, deliver);
  }
  bool holds_any() const noexcept { return held_count_ > 0; }

 private:
  struct Held {
    Datagram datagram;
    std::int64_t due_ns = 0;
    bool until_overtaken = false;  ///< delivered before `due_ns` if another datagram arrives
  };
  // Returns the number of copies that are delivered immediately.
  int decide(Datagram& datagram, double t_s, std::int64_t now_ns) noexcept;
  bool happens(double probability) noexcept;
  void hold(const Datagram& datagram, std::int64_t due_ns, bool until_overtaken) noexcept;

  template <typename Deliver>
  void release(std::int64_t now_ns, bool overtaken, Deliver&& deliver) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < held_count_; ++i) {
      if (held_[i].due_ns <= now_ns || (overtaken && held_[i].until_overtaken)) {
        deliver(held_[i].datagram);
      } else if (kept++ != i) {
        held_[kept - 1] = held_[i];
      }
    }
    held_count_ = kept;
  }

  FaultPlan plan_;
  std::mt19937_64 random_;
  std::vector<Held> held_;  ///< the size is always kHeld
  std::size_t held_count_ = 0;
};

}  // namespace trocar::runtime
