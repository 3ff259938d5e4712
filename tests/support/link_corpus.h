// SPDX-License-Identifier: Apache-2.0
// The packets of tests/corpus/packet, which were made from device_link.md.
#pragma once

#include <tuple>

#include "formats/session/device_protocol.h"

namespace trocar::link_corpus {

inline constexpr LinkNonce kHost = {1, 2, 3}, kDrive = {4, 5, 6};

/// start_link() must have been called for all functions but this one.
inline LinkKey shared_key() {
  LinkKey key;
  for (std::size_t i = 0; i < key.bytes.size(); ++i)
    key.bytes[i] = static_cast<std::uint8_t>(7 * i + 1);
  return key;
}

template <typename Packet>
LinkKey key_for() {
  constexpr bool is_of_session = requires(Packet packet) {
    packet.session;
  };
  return is_of_session ? session_key(shared_key(), kHost, kDrive) : shared_key();
}

using Packets = std::tuple<HelloPacket, WelcomePacket, CommandPacket, StatePacket,
                           WrenchCommandPacket, PoseStatePacket>;

inline Packets packets() {
  const std::uint64_t session = session_number(kDrive);
  CommandPacket command{session, 1, 3000, CommandMode::kTorque, 1, {}};
  StatePacket state{session, 1, 4000, DriveMode::kTorque, 0, 1, {}};
  for (std::size_t i = 0; i < kLinkMotors; ++i)
    command.tau_motor_Nm[i] = 0.25 * static_cast<double>(i) - 1;
  for (std::size_t i = 0; i < kLinkEncoders; ++i)
    state.encoder_rad[i] = 0.125 * static_cast<double>(i) - 1;
  return {{1000, kHost, 1e-3, true},
          {2000, kHost, kDrive, 2.5e-4, LinkClock::kReal},
          command,
          state,
          {session, 1, 3000, CommandMode::kTorque, 1, {-1, -0.75, -0.5}, {-0.25, 0, 0.25}},
          {session, 1, 4000, DriveMode::kTorque, 0, 6, 1, {-1, -0.875, -0.75}, {0.6, -0.8, 0, 0}}};
}

/// hello_pose.bin.
inline HelloPacket hello_for_poses() {
  return {1000, kHost, 1e-3, true, LinkContents::kPose};
}

}  // namespace trocar::link_corpus
