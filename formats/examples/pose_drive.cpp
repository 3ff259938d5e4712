// SPDX-License-Identifier: Apache-2.0
// A drive for a device of your own: the process between your device's SDK and Trocar. Copy this file, and replace
// read_device(), apply_wrench() and begin_session(). docs/add-your-device.md says how, and formats/session/device_link.md
// specifies the packets. The computer must be little-endian.
//   g++ -std=c++20 -O2 pose_drive.cpp -o pose_drive -lsodium && ./pose_drive link.key 7700
#include <netinet/in.h>
#include <sodium.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>

// clang-format off
// ---- Your device: replace the contents of the three functions by calls of your SDK. ------------------------------
constexpr double kPeriod_s = 5e-4;  // both are called this often
constexpr bool kSdkWaits = false;   // true: read_device() waits for the next sample, so the drive does not sleep
using Wrench = std::array<double, 6>;
struct Reading {
  std::array<double, 3> position_m;   // of the handle's point, in the device's frame
  std::array<double, 4> orientation;  // of the handle in the device's frame, w x y z; 1 0 0 0 if it is not sensed
  uint32_t buttons;                   // bit i: button i is pressed
  uint8_t fault;                      // not 0: the device reports a fault, or has no pose; then state the last pose
  bool stop_is_pressed;               // the emergency stop; false if there is none
};
// In place of a device: a mass of 0.2 kg, held by a hand (1000 N/m) that can go down by 40 mm and up again, in 8 s.
double x_m[] = {0, 0, 0.02}, v_m_per_s[3], force_N[3], t_s = 0, hand_speed = 0;
Reading read_device() {
  t_s += hand_speed * kPeriod_s;
  const double hand_m[] = {0, 0, 0.02 * std::cos(2 * M_PI * t_s / 8)};
  for (int i = 0; i < 3; ++i) {
    v_m_per_s[i] += (force_N[i] + 1000 * (hand_m[i] - x_m[i]) - 20 * v_m_per_s[i]) / 0.2 * kPeriod_s;
    x_m[i] += v_m_per_s[i] * kPeriod_s;
  }
  return {{x_m[0], x_m[1], x_m[2]}, {1, 0, 0, 0}, 0, 0, false};
}
// The force in N on the handle's point, then the moment in N m about this point, in the device's frame.
void apply_wrench(const Wrench& wrench) { std::copy_n(wrench.begin(), 3, force_N); }
// Called when a host begins a session, before its first state. Here the hand begins above; a device may need nothing.
void begin_session() { x_m[0] = x_m[1] = t_s = 0, x_m[2] = 0.02, v_m_per_s[0] = v_m_per_s[1] = v_m_per_s[2] = 0; }

// ---- The device link. Nothing below depends on the device. -------------------------------------------------------
using Key = std::array<uint8_t, 32>;  // or a MAC
using Nonce = std::array<uint64_t, 2>; struct Nonces { Nonce host, drive; };
struct Header { uint8_t magic[4], version, kind; uint16_t bytes; uint64_t session, sequence; int64_t time_ns; };
struct Hello { Header h; Nonce nonce; double period_s; uint8_t resets_world, contents, zero[6]; Key mac; };    // kind 1
struct Welcome { Header h; Nonces nonces; double period_s; uint8_t clock, zero[7]; Key mac; };          // kind 2
struct Denial { Header h; Nonce nonce; uint8_t reason, zero[7]; };                                      // kind 5
struct Command { Header h; uint8_t mode, zero[7]; uint64_t newest_state; Wrench wrench; Key mac; };     // kind 6
struct State { Header h; uint8_t mode, fault, zero[2]; uint32_t buttons; uint64_t newest_command;       // kind 7
               std::array<double, 3> position_m; std::array<double, 4> orientation; Key mac; };
static_assert(sizeof(Hello) + sizeof(Welcome) + sizeof(Denial) + sizeof(Command) + sizeof(State) == 528);
enum CommandMode : uint8_t { kFree = 1, kForce = 2, kStop = 3 };
enum Mode : uint8_t { kReady = 1, kApplies = 2, kWatchdog = 3, kEmergencyStop = 4 };
struct Session { bool exists = false; Nonces nonces{}; double watchdog_s = 0; Key key{};
                 uint64_t newest_command = 0, states_sent = 0, acknowledge_from = 0;  // a state after a stop, or 0
                 uint8_t fault = 0; Mode mode = kReady; Wrench wrench{}; sockaddr_in host{}; bool continues = false; };
Session session, offer; bool stop_is_untold = false;  // the offer becomes the session with its first command
Key shared_key; int fd; double watchdog_s = 0.01; int64_t command_ns, denial_ns; volatile std::sig_atomic_t is_running = 1;
int64_t now_ns() { timespec t; clock_gettime(CLOCK_MONOTONIC, &t); return t.tv_sec * 1'000'000'000L + t.tv_nsec; }
bool is_alive() { return session.exists && double(now_ns() - command_ns) * 1e-9 <= session.watchdog_s; }
Key mac_of(const void* bytes, size_t count, const Key& key) {
  Key mac;
  crypto_generichash(mac.data(), 32, static_cast<const uint8_t*>(bytes), count, key.data(), 32);
  return mac;
}
bool authentic(const auto& p, const Key& k) { return sodium_memcmp(&mac_of(&p, sizeof p - 32, k)[0], &p.mac, 32) == 0; }
void send(auto p, uint8_t kind, uint64_t number, uint64_t sequence, int64_t ns, const Key& key, const sockaddr_in& to) {
  p.h = {{'T', 'R', 'C', 'R'}, 1, kind, sizeof p, number, sequence, ns};
  if constexpr (requires { p.mac; }) p.mac = mac_of(&p, sizeof p - 32, key);
  sendto(fd, &p, sizeof p, 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
}
void end_force(Mode m) { session.mode = m, session.wrench = {}, session.acknowledge_from = session.states_sent + 1; }
void take(const Hello& hello, const sockaddr_in& from) {
  const bool has_key = authentic(hello, shared_key);
  if (!has_key || hello.contents != 1 || is_alive()) {
    if (now_ns() - denial_ns < 100'000'000) return;
    const Denial denial{{}, hello.nonce, uint8_t(!has_key ? 1 : hello.contents != 1 ? 3 : 2), {}};
    return send(denial, 5, 0, 1, denial_ns = now_ns(), {}, from);
  }
  if (hello.resets_world > 1 || !sodium_is_zero(hello.zero, 6) || !(hello.period_s >= 1e-5 && hello.period_s <= 0.1)) return;
  if (!offer.exists || offer.nonces.host != hello.nonce) {
    offer = {true, {hello.nonce, {}}, std::max(watchdog_s, 2.5 * hello.period_s)};
    randombytes_buf(&offer.nonces.drive, 16), offer.continues = hello.resets_world == 0;
    uint8_t text[45] = "trocar link 1";
    std::memcpy(text + 13, &offer.nonces, 32);
    offer.key = mac_of(text, 45, shared_key);
  }
  send(Welcome{{}, offer.nonces, kPeriod_s, 1, {}, {}}, 2, offer.nonces.drive[0], 1, now_ns(), shared_key, from);
}
void take(const Command& command, const sockaddr_in& from) {
  const bool begins = !session.exists || command.h.session != session.nonces.drive[0], zeros = command.wrench == Wrench{};
  Session& of = begins ? offer : session;
  if (!of.exists || command.h.session != of.nonces.drive[0] || (begins && is_alive())) return;
  if (!authentic(command, of.key) || command.h.sequence <= of.newest_command) return;
  bool good = command.mode == kForce || (zeros && (command.mode == kFree || command.mode == kStop));
  for (const double each : command.wrench) good = good && std::abs(each) <= 1000;  // false if it is not a number
  if (!good || !sodium_is_zero(command.zero, 7)) return;
  if (begins) session = offer, offer = {}, begin_session(), stop_is_untold &= session.continues;
  if (begins && stop_is_untold) end_force(kEmergencyStop);
  if (command.mode == kStop) session = {};
  session.newest_command = command.h.sequence, session.host = from, command_ns = now_ns();
  if (zeros && command.newest_state >= session.acknowledge_from) session.acknowledge_from = 0, stop_is_untold = false;
  if (session.acknowledge_from != 0) return;
  session.mode = command.mode == kForce ? kApplies : kReady, session.wrench = command.wrench;
}
void tick() {
  const Reading r = read_device();  stop_is_untold |= r.stop_is_pressed;
  const int64_t now = now_ns();  // the time of the reading; if your SDK states it on CLOCK_MONOTONIC, take that
  if (r.stop_is_pressed && session.mode != kEmergencyStop) end_force(kEmergencyStop);
  if (session.mode == kApplies && !is_alive()) end_force(kWatchdog);
  apply_wrench(session.wrench);
  if (now - command_ns > 1'000'000'000) session = {};
  if (!session.exists) return;
  Session& s = session;  s.fault |= r.fault;
  const State state{{}, s.mode, s.fault, {}, r.buttons, s.newest_command, r.position_m, r.orientation, {}};
  send(state, 7, s.nonces.drive[0], ++s.states_sent, now, s.key, s.host);
}
int main(int argc, char** argv) {
  char text[64];
  std::FILE* const file = argc < 3 ? nullptr : std::fopen(argv[1], "r");
  if (sodium_init() < 0 || file == nullptr || std::fread(text, 1, 64, file) != 64 ||
      sodium_hex2bin(shared_key.data(), 32, text, 64, nullptr, nullptr, nullptr) != 0)
    return std::fputs("usage: pose_drive KEY_FILE PORT [move]\nKEY_FILE has 64 hexadecimal digits.\n", stderr), 2;
  if (argc > 3) hand_speed = 1, watchdog_s = 0.25;  // without motors a busy computer may hold the drive up for longer
  fd = socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK, 0);
  sockaddr_in at{AF_INET, htons(uint16_t(std::atoi(argv[2]))), {htonl(INADDR_LOOPBACK)}, {}};  // for this computer only
  if (bind(fd, reinterpret_cast<const sockaddr*>(&at), sizeof at) != 0) return std::perror("pose_drive"), 2;
  for (const int signal : {SIGINT, SIGTERM}) std::signal(signal, [](int) { is_running = 0; });
  std::printf("ready on 127.0.0.1:%s\n", argv[2]), std::fflush(stdout);
  union { Header h; Hello hello; Command command; uint8_t all[512]; } p;
  for (int64_t next_ns = now_ns(); is_running;) {
    for (int left = 100; left > 0; --left) {  // not endless, so that a flood does not stop the watchdog
      socklen_t length = sizeof at;
      const ssize_t size = recvfrom(fd, &p, sizeof p, 0, reinterpret_cast<sockaddr*>(&at), &length);
      if (size < 0) break;
      if (size < 32 || std::memcmp(&p, "TRCR\1", 5) != 0 || p.h.bytes != size) continue;
      if (p.h.kind == 1 && size == sizeof p.hello) take(p.hello, at);
      if (p.h.kind == 6 && size == sizeof p.command) take(p.command, at);
    }
    tick();
    next_ns = std::max(next_ns + int64_t(kPeriod_s * 1e9), now_ns());
    const timespec until{next_ns / 1'000'000'000, next_ns % 1'000'000'000};
    if (!kSdkWaits) clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
  }
  apply_wrench({});
}
