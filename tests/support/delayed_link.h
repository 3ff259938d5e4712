// SPDX-License-Identifier: Apache-2.0
// A simulated drive behind a link that delays, reorders and loses packets, with a host whose ticks
// may come late, in virtual time: the same seed gives the same packets. It also gives the true
// motion of the tool at the state that the host used last.
#pragma once

#include <cstdint>
#include <random>
#include <utility>
#include <vector>

#include "runtime/device/simulated/simulated_device.h"

namespace trocar::test {

struct DelayedLinkOptions {
  double delay_max_s = 0;          ///< a packet's delay is uniform from 0 to this, either way
  double loss = 0;                 ///< fraction of packets that never arrive, either way
  double drive_period_s = 2.5e-4;  ///< time between two states of the drive
  double host_stop_s = 0;          ///< duration of a stall of the host
  int ticks_between_stops = 1;     ///< number of ticks from one stall to the next
  std::uint64_t seed = 1;
};

class DelayedLink final : public runtime::Device {
 public:
  DelayedLink(const DelayedLinkOptions& options, runtime::SimulatedDevice drive)
      : options_(options), drive_(std::move(drive)), random_(options.seed) {
    send_state();
  }

  DeviceStatus read(runtime::DeviceState& state) noexcept override {
    const Packet* newest = nullptr;
    for (const Packet& packet : states_) {
      if (packet.arrives_s <= now_s_ && packet.number > seen_) {
        newest = &packet;
        seen_ = packet.number;
      }
    }
    if (newest == nullptr) return DeviceStatus::kNoData;
    state = newest->state;
    used_ = newest->truth;
    std::erase_if(states_, [this](const Packet& packet) { return packet.number <= seen_; });
    return DeviceStatus::kOk;
  }
  DeviceStatus write(const runtime::DeviceCommand& command) noexcept override {
    Packet packet;
    packet.command = command;
    packet.number = ++commands_sent_;
    send(packet, commands_);
    return DeviceStatus::kOk;
  }
  /// Advances the drive's time to the host's next tick.
  void advance(double dt_s) noexcept override {
    tick_s_ += dt_s;
    if (options_.host_stop_s > 0 && ++ticks_ % options_.ticks_between_stops == 0) {
      tick_s_ += options_.host_stop_s;
    }
    while (now_s_ + options_.drive_period_s / 2 < tick_s_) {
      take_commands();
      drive_.step(options_.drive_period_s);
      now_s_ += options_.drive_period_s;
      send_state();
    }
  }
  /// The tool at the time of the state that the host used last.
  const runtime::TrueTip& used() const noexcept { return used_; }
  double now_s() const noexcept { return now_s_; }

 private:
  struct Packet {
    std::uint64_t number = 0;
    double arrives_s = 0;
    runtime::DeviceState state;
    runtime::DeviceCommand command;
    runtime::TrueTip truth;
  };
  double uniform() noexcept { return static_cast<double>(random_() >> 11) * 0x1p-53; }
  void send(Packet packet, std::vector<Packet>& way) {
    const bool lost = uniform() < options_.loss;
    packet.arrives_s = now_s_ + uniform() * options_.delay_max_s;
    if (!lost) way.push_back(packet);
  }
  void send_state() {
    Packet packet;
    drive_.read(packet.state);
    packet.number = ++states_sent_;
    packet.truth = drive_.tip();
    send(packet, states_);
  }
  void take_commands() {
    for (const Packet& packet : commands_) {
      if (packet.arrives_s > now_s_ || packet.number <= command_taken_) continue;
      command_taken_ = packet.number;
      drive_.write(packet.command);
    }
    std::erase_if(commands_,
                  [this](const Packet& packet) { return packet.number <= command_taken_; });
  }

  DelayedLinkOptions options_;
  runtime::SimulatedDevice drive_;
  std::mt19937_64 random_;
  std::vector<Packet> states_, commands_;
  std::uint64_t states_sent_ = 0, commands_sent_ = 0, seen_ = 0, command_taken_ = 0;
  double now_s_ = 0, tick_s_ = 0;
  int ticks_ = 0;
  runtime::TrueTip used_;
};

}  // namespace trocar::test
