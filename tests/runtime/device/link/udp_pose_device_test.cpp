// SPDX-License-Identifier: Apache-2.0
// A drive that states poses, over real sockets of this machine, as a PoseDevice. The template UdpLink, which it shares
// with the four-legged device's drive, is tested in udp_device_test.cpp.

#include <gtest/gtest.h>
#include <sodium.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "runtime/device/link/udp_link.h"
#include "runtime/realtime/realtime_thread.h"
#include "tests/support/counted_allocations.h"

namespace trocar::runtime {
namespace {

void pause_ms(int ms) {
  std::this_thread::sleep_for(std::chrono::milliseconds(ms));
}

/// A drive on a socket, run by a thread. Its clock advances by 1 ms for each state, and its handle moves along x.
class PosePeer {
 public:
  PosePeer()
      : socket_(std::move(*UdpSocket::listen({0x7f000001, 0}))),
        key(random_link_key()),
        endpoint(socket_.local()) {
    thread_ = std::thread([this] { serve(); });
  }
  ~PosePeer() {
    done_ = true;
    thread_.join();
  }
  PosePeer(const PosePeer&) = delete;
  PosePeer& operator=(const PosePeer&) = delete;

  std::atomic<bool> mute{false};  ///< no states are sent
  std::atomic<std::uint8_t> faults{0};
  static constexpr std::size_t kNoByte = kMaxPacketBytes;
  std::atomic<std::size_t> wrong_byte{
      kNoByte};  ///< each state is sent with wrong bits in this byte
  std::atomic<std::uint8_t> wrong_bits{0};
  std::atomic<bool> is_sealed_again{false};  ///< ... and with the MAC that belongs to it

  WrenchCommandPacket newest_command() {
    const std::lock_guard lock(mutex_);
    return newest_command_;
  }

 private:
  UdpSocket socket_;

 public:
  const LinkKey key;
  const Endpoint endpoint;

 private:
  void serve() {
    while (!done_) {
      socket_.wait(1e-3);
      std::array<std::uint8_t, 512> buffer;
      std::size_t bytes = 0;
      Endpoint from;
      while (socket_.receive(buffer, bytes, from) == UdpSocket::Outcome::kDone)
        take(std::span(buffer).first(std::min(bytes, buffer.size())), from);
      if (last_command_ > 0) send_state();
    }
  }
  void take(std::span<const std::uint8_t> bytes, const Endpoint& from) {
    std::array<std::uint8_t, kMaxPacketBytes> answer{};
    HelloPacket hello;
    if (decode(bytes, key, hello) == LinkRefusal::kNone) {
      if (hello.host_nonce != host_nonce_) {
        host_nonce_ = hello.host_nonce;
        drive_nonce_ = random_nonce();
        session_key_ = session_key(key, host_nonce_, drive_nonce_);
        last_command_ = last_state_ = 0;
      }
      const std::size_t size =
          encode(WelcomePacket{0, host_nonce_, drive_nonce_, 1e-3, LinkClock::kReal}, key, answer);
      socket_.send_to(std::span(answer).first(size), from);
      return;
    }
    WrenchCommandPacket command;
    if (decode(bytes, session_key_, session_number(drive_nonce_), last_command_, command) !=
        LinkRefusal::kNone) {
      return;
    }
    host_ = from;
    const std::lock_guard lock(mutex_);
    newest_command_ = command;
  }
  void send_state() {
    if (mute) return;
    PoseStatePacket state;
    state.session = session_number(drive_nonce_);
    state.sequence = ++last_state_;
    state.time_ns = ++ticks_ * 1'000'000;
    state.mode = DriveMode::kTorque;
    state.faults = faults;
    state.buttons = 5;
    state.command_taken = last_command_;
    state.p_m = {1e-6 * static_cast<double>(ticks_), -0.25, 0.125};
    state.q = {0.5, -0.5, 0.5, -0.5};
    std::array<std::uint8_t, kMaxPacketBytes> bytes{};
    const auto packet = std::span(bytes).first(encode(state, session_key_, bytes));
    if (wrong_byte != kNoByte) {
      bytes.at(wrong_byte) ^= wrong_bits;
      const auto mac = packet.last(kLinkMacBytes);
      if (is_sealed_again) {
        crypto_generichash(mac.data(), mac.size(), bytes.data(), packet.size() - mac.size(),
                           session_key_.bytes.data(), session_key_.bytes.size());
      }
    }
    socket_.send_to(packet, host_);
  }

  LinkNonce host_nonce_{}, drive_nonce_{};
  LinkKey session_key_;
  std::uint64_t last_command_ = 0, last_state_ = 0;
  std::int64_t ticks_ = 0;
  Endpoint host_;
  std::mutex mutex_;
  WrenchCommandPacket newest_command_;
  std::atomic<bool> done_{false};
  std::thread thread_;
};

UdpLinkOptions to(const PosePeer& peer) {
  UdpLinkOptions options;
  options.peer = peer.endpoint;
  options.key = peer.key;
  options.clock = LinkClock::kReal;
  options.no_state_s = 5;  // longer than this machine ever stalls
  return options;
}

std::unique_ptr<UdpPoseDevice> connected_pose(const UdpLinkOptions& options) {
  auto device = UdpPoseDevice::make(options);
  EXPECT_TRUE(device) << device.error().message;
  if (!device) return nullptr;
  const Result<void> started = (*device)->start();
  EXPECT_TRUE(started) << started.error().message;
  return started ? std::move(*device) : nullptr;
}

/// Reads until the status is `wanted`, for at most five seconds; requests a new session if the link is lost.
bool reaches(UdpPoseDevice& device, PoseReading& reading, DeviceStatus wanted,
             bool restores = false) {
  for (int ms = 0; ms < 5000; ++ms) {
    const DeviceStatus status = device.read(reading);
    if (status == wanted) return true;
    if (restores && status != DeviceStatus::kNoData) device.restore();
    device.write({});
    pause_ms(1);
  }
  return false;
}

TEST(UdpPoseDevice, ReceivesPosesAndSendsWrenches) {
  PosePeer peer;
  const auto device = connected_pose(to(peer));
  ASSERT_TRUE(device);
  PoseReading reading;
  double last_s = 0;
  for (int tick = 0; tick < 50; ++tick) {
    ASSERT_TRUE(reaches(*device, reading, DeviceStatus::kOk));
    EXPECT_GT(reading.t_s, last_s);
    last_s = reading.t_s;
    EXPECT_NEAR(reading.p_m[0], 1e-3 * reading.t_s, 1e-12);
    EXPECT_EQ(reading.p_m[2], 0.125);
    EXPECT_EQ(reading.q, (std::array<double, 4>{0.5, -0.5, 0.5, -0.5}));
    EXPECT_EQ(reading.buttons, 5U);
    ASSERT_EQ(device->write({1, 2, 3, 0.1, 0.2, 0.3}), DeviceStatus::kOk);
  }
  for (int ms = 0; ms < 5000 && peer.newest_command().force_N[0] == 0; ++ms)
    pause_ms(1);
  EXPECT_EQ(peer.newest_command().mode, CommandMode::kTorque);
  EXPECT_EQ(peer.newest_command().force_N, (std::array<double, 3>{1, 2, 3}));
  EXPECT_EQ(peer.newest_command().moment_Nm, (std::array<double, 3>{0.1, 0.2, 0.3}));
  EXPECT_EQ(device->packets().refused(), 0U);
  EXPECT_GT(device->link_report()->round_trip.samples(), 10U);
  EXPECT_FALSE(device->is_paced_by_loop());
  device->close();
  for (int ms = 0; ms < 5000 && peer.newest_command().mode != CommandMode::kStop; ++ms)
    pause_ms(1);
  EXPECT_EQ(peer.newest_command().mode, CommandMode::kStop);
}

// An IMU that has lost its lock, or a broken encoder: the link works, and its states do not.
TEST(UdpPoseDevice, StatesRefusedInASessionAreToldFromALostLink) {
  PosePeer peer;
  std::mutex mutex;
  std::vector<std::string> said;
  UdpLinkOptions options = to(peer);
  options.no_state_s = 0.3;
  options.connect_timeout_s = 0.5;
  options.say = [&](const std::string& line) {
    const std::lock_guard lock(mutex);
    said.push_back(line);
  };
  const auto device = connected_pose(options);
  ASSERT_TRUE(device);
  PoseReading reading;
  ASSERT_TRUE(reaches(*device, reading, DeviceStatus::kOk));
  peer.mute = true;
  ASSERT_TRUE(reaches(*device, reading, DeviceStatus::kLinkLost));
  EXPECT_EQ(device->refused_contents(), Fault::kNone);
  peer.mute = false;
  ASSERT_TRUE(reaches(*device, reading, DeviceStatus::kOk, true));

  peer.is_sealed_again = true;
  peer.wrong_bits = 0x40;
  peer.wrong_byte = 55;  // the exponent of x
  ASSERT_TRUE(reaches(*device, reading, DeviceStatus::kLinkLost));
  const FaultDetail refused = device->refused_contents();
  EXPECT_EQ(refused, Fault::kRefusedState);
  EXPECT_EQ(refused.quantity, FaultQuantity::kMeasuredPosition);
  EXPECT_EQ(refused.index, 0);
  EXPECT_GT(std::abs(refused.value), 10);
  const auto count = [&](const char* words) {
    const std::lock_guard lock(mutex);
    return std::count_if(said.begin(), said.end(), [&](const std::string& line) {
      return line.find(words) != std::string::npos;
    });
  };
  device->restore();
  for (int ms = 0; ms < 5000 && count("refused (contents)") == 0; ++ms)
    pause_ms(1);
  pause_ms(1200);  // another attempt at least, with the same reason
  EXPECT_EQ(count("refused (contents)"), 1);
  peer.wrong_bits = 0;
  EXPECT_TRUE(reaches(*device, reading, DeviceStatus::kOk, true));
  EXPECT_EQ(device->refused_contents(), Fault::kNone);
}

TEST(UdpPoseDevice, ReportsAFaultWithItsByte) {
  PosePeer peer;
  const auto device = connected_pose(to(peer));
  ASSERT_TRUE(device);
  PoseReading reading;
  peer.faults = 0x80;
  EXPECT_TRUE(reaches(*device, reading, DeviceStatus::kMotorFault));
  EXPECT_EQ(device->fault_byte(), 0x80);
  peer.faults = 0;
  EXPECT_TRUE(reaches(*device, reading, DeviceStatus::kOk, true));
}

TEST(UdpPoseDevice, StartNamesWhatMayBeWrongIfTheDriveGivesNoReason) {
  PosePeer peer;
  UdpLinkOptions options = to(peer);
  options.connect_timeout_s = 0.3;
  options.key = random_link_key();
  auto device = UdpPoseDevice::make(options);
  ASSERT_TRUE(device);
  const Result<void> started = (*device)->start();
  ASSERT_FALSE(started);
  EXPECT_NE(started.error().message.find("or states angles (--device udp:)"), std::string::npos)
      << started.error().message;
}

TEST(UdpPoseDevice, StartSaysWhyStatesAreRefused) {
  struct Wrong {
    std::size_t byte;
    std::uint8_t bits;
    bool is_sealed_again;
    const char* words;
  };
  // The bytes belong to x (its exponent), w, the session, the kind and the size.
  const Wrong all[] = {
      {55, 0x40, true, "refused (contents): measured position x "},
      {79, 1, false, "refused (mac): they must have a MAC with the key of the session"},
      {15, 0xff, true, "refused (session): they do not have the number of this session"},
      {5, 4, true, "refused (kind): they do not begin like a state"},
      {6, 1, true, "refused (size): "},
  };
  for (const Wrong& wrong : all) {
    PosePeer peer;
    peer.wrong_byte = wrong.byte;
    peer.wrong_bits = wrong.bits;
    peer.is_sealed_again = wrong.is_sealed_again;
    UdpLinkOptions options = to(peer);
    options.connect_timeout_s = 0.5;
    auto device = UdpPoseDevice::make(options);
    ASSERT_TRUE(device);
    const Result<void> started = (*device)->start();
    ASSERT_FALSE(started) << wrong.words;
    EXPECT_EQ(started.error().code, ExitCode::kDeviceFault);
    EXPECT_NE(started.error().message.find(wrong.words), std::string::npos)
        << started.error().message;
    EXPECT_EQ((*device)->packets().accepted(), 1U) << "the welcome";
  }
}

TEST(UdpPoseDevice, ReadAndWriteAllocateNothing) {
  TROCAR_NEEDS_COUNTED_ALLOCATIONS();
  PosePeer peer;
  const auto device = connected_pose(to(peer));
  ASSERT_TRUE(device);
  PoseReading reading;
  const std::uint64_t before = allocations_in_scopes();
  for (int tick = 0; tick < 100; ++tick) {
    {
      const NoAllocationScope scope;
      device->read(reading);
      device->write({});
    }
    pause_ms(1);
  }
  EXPECT_EQ(allocations_in_scopes(), before);
  EXPECT_GT(device->packets().accepted(), 10U);
}

}  // namespace
}  // namespace trocar::runtime
