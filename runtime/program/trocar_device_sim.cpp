// SPDX-License-Identifier: Apache-2.0
// trocar-device-sim: the simulated device with its hand behind the device link, in real time or in
// lock-step with its host. This file has the command line, the socket and the clock. The drive
// itself is runtime/device/simulated/drive.h.
#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "formats/base/command_line.h"
#include "formats/base/files.h"
#include "formats/base/json.h"
#include "formats/base/text.h"
#include "formats/session/device_description.h"
#include "formats/session/scene.h"
#include "runtime/device/link/link_key.h"
#include "runtime/device/link/udp_link.h"
#include "runtime/device/simulated/drive.h"
#include "runtime/program/library_versions.h"
#include "runtime/realtime/realtime_thread.h"
#include "runtime/session/open_device.h"
#include "runtime/session/session.h"

namespace trocar::runtime {
namespace {

constexpr const char* kName = "trocar-device-sim";

struct Arguments {
  std::string scene, listen = "127.0.0.1:4840", key_file, faults, description, summary, record;
  DriveOptions drive;
  MechanicsOptions mechanics;
  bool is_full = false;  ///< simulates `mechanics`
  double rate_Hz = 4000;
  std::uint64_t sessions = 0;
  bool quiet = false;
};

int fail(const Error& error) {
  return report_error(kName, error);
}

void declare(CLI::App& line, Arguments& a) {
  constexpr double kMost = 9e15;  // a double has all whole numbers up to it
  line.add_option(
      "SCENE", a.scene,
      "the scene (JSON) with the simulated hand that holds the tool. Without a scene, nothing\n"
      "holds the tool");
  line.add_option(
          "--listen", a.listen,
          "ADDRESS:PORT to listen on; port 0: any free one (default: 127.0.0.1:4840). Beyond this\n"
          "computer, the key file must exist already")
      ->type_name("ADDRESS:PORT");
  line.add_option("--key-file", a.key_file,
                  "secret key, by which this program and trocar-run recognise each other; made "
                  "(mode 0600) if\n"
                  "there is no such file")
      ->type_name("FILE")
      ->required();
  add_choice<LinkClock>(
      line, "--clock", a.drive.clock,
      {{"real", LinkClock::kReal}, {"lock-step", LinkClock::kLockStep}},
      "real: time follows the wall clock; lock-step, for trocar-run --clock virtual: time\n"
      "advances by one tick for each command of trocar-run (default: real)");
  add_number(line, "--rate", a.rate_Hz, {100.0, 10'000.0, "HZ", "Hz"},
             "rate of the drive, the simulated electronics of the motors, 100 to 10000 Hz");
  add_number(
      line, "--watchdog", a.drive.watchdog_s, {0.01, 0.5, "S", "s"},
      "time without a command after which the torques go to zero, 0.01 to 0.5 s, at least 2.5\n"
      "ticks of trocar-run (on a computer that does other work, 0.25)");
  add_choice<bool>(
      line, "--model", a.is_full, {{"light", false}, {"full", true}},
      "what is simulated. light: the plate that the hand holds, with viscous friction; full:\n"
      "also links, rotors, dry friction and the lag of the motors' currents (default: light)");
  add_number(line, "--encoder-noise", a.mechanics.encoder_noise_rad, {0.0, 0.1, "RAD", "rad"},
             "standard deviation of the noise of measured angles, rad; needs --model full");
  line.add_option(
          "--faults", a.faults,
          "faults to inject, separated by commas: KIND[:VALUE[:VALUE]][@FROM[..TO]]. FROM and TO\n"
          "are seconds since the session's start. Faults of packets, with probability P: loss:P,\n"
          "delay:P:MS (by MS ms), duplicate:P, reorder:P, flip:P (one bit is inverted). With the\n"
          "prefix command- or state-, as in command-loss:P, only packets of that kind are "
          "affected.\n"
          "Faults of the device: stuck:ENCODER, jump:ENCODER:RAD, dead:MOTOR (ENCODER is 0 to 15,\n"
          "MOTOR is 0 to 7), stop (its emergency stop is pressed), kill (its process is killed)")
      ->type_name("FAULTS");
  add_number(line, "--seed", a.mechanics.seed, {0, kMost, "N"},
             "seed of the random faults and noise");
  add_number(line, "--sessions", a.sessions, {0, kMost, "N"},
             "end after this many sessions of trocar-run; 0: run until stopped. With\n"
             "--clock lock-step also 10 s after a trocar-run on this computer has died in the last "
             "one");
  line.add_option("--device-description", a.description,
                  "geometry and limits of the device (JSON), instead of the scene's")
      ->type_name("FILE");
  line.add_option("--record", a.record,
                  "write a CSV file with a row for each of the first million steps of 1 / --rate: "
                  "mode of the\n"
                  "drive, largest torque and position of the tip")
      ->type_name("FILE");
  line.add_option(
          "--summary", a.summary,
          "write counts (sessions, packets, watchdog trips) and forces on the hand, as JSON")
      ->type_name("FILE");
  line.add_flag("--quiet", a.quiet, "print errors and the address only");
  line.footer(
      "Exit codes: 0 done or stopped by Ctrl-C; 2 wrong usage; 3 input refused; 4 a file could\n"
      "not be written, or the address is not available; 1 an internal error.\n"
      "The page formats/session/device_link.md describes the protocol.");
}

Result<LinkKey> load_key(const Arguments& arguments, const Endpoint& local) {
  if (Result<void> started = start_link(); !started) return started.error();
  std::error_code ignored;
  if (!std::filesystem::exists(std::filesystem::symlink_status(arguments.key_file, ignored))) {
    if (local.is_loopback()) return make_link_key(arguments.key_file);
    return usage("--listen " + arguments.listen +
                 ": an address other than loopback needs a key file that exists already; " +
                 arguments.key_file + " does not");
  }
  return read_link_key(arguments.key_file);
}

Result<SimulatedDevice> load_model(const Arguments& arguments) {
  std::optional<MechanicsOptions> mechanics;
  if (arguments.is_full) mechanics = arguments.mechanics;
  std::optional<Scene> scene;
  std::string description_file = arguments.description;
  if (!arguments.scene.empty()) {
    if (const auto ok = read_scene(arguments.scene).into(scene); !ok) return ok.error();
    if (scene->hand.live)
      return usage(arguments.scene + ": its hand is live, which is for trocar-run --device inproc");
    if (description_file.empty() && scene->device) description_file = scene->device->string();
  }
  DeviceDescription description = default_device_description();
  if (!description_file.empty()) {
    if (const auto ok = read_device_description(description_file).into(description); !ok)
      return ok.error();
  }
  description.delay_s.reset();  // the link's comes by itself
  if (scene) {
    Result<SimulatedDevice> made = make_simulated_device(*scene, description, nullptr, mechanics);
    if (!made) return made.error().after(arguments.scene + ": ");
    return made;
  }
  SimulatedDeviceOptions options;
  options.mechanics = mechanics;
  return SimulatedDevice::make(description, {}, {}, options);
}

constexpr std::size_t kMaxRecordedSteps = 1'000'000;

Result<void> write_record(const std::string& file, const DriveReport& report) {
  return file.empty() ? Result<void>{} : write_file_atomically(file, to_csv(report.steps));
}

/// A drive and its socket, with a faulty link between the two.
class Server {
 public:
  Server(const DriveOptions& options, SimulatedDevice model, UdpSocket socket,
         const Arguments& arguments)
      : drive_(options, std::move(model)),
        socket_(std::move(socket)),
        in_(options.faults, LinkDirection::kCommands, 2 * arguments.mechanics.seed),
        out_(options.faults, LinkDirection::kStates, 2 * arguments.mechanics.seed + 1),
        sessions_(arguments.sessions),
        record_(arguments.record),
        period_s_(options.period_s) {}

  RealtimeReport run_real() {
    RealtimeOptions realtime;
    realtime.rate_Hz = 1 / period_s_;
    realtime.priority = 70;  // less than the haptic loop's priority
    realtime.stop = &stop_requested;
    return run_realtime(realtime, [this](const TickTiming& timing) {
      periods_behind_ += timing.gap_s > 0 ? timing.gap_s / period_s_ : 1;
      const double periods = std::clamp(std::round(periods_behind_), 0.0, kMaxCatchUpPeriods);
      periods_behind_ = std::min(periods_behind_ - periods, 1.0);
      const std::int64_t now = monotonic_ns();
      const int missed = std::max(static_cast<int>(periods) - 1, 0);
      drive_.catch_up(now - std::llround(period_s_ * 1e9), missed);
      serve(now);
      Drive::Answer state;
      drive_.tick(now, static_cast<int>(periods) - missed, state);
      send(state, host_);
      kill_if_due();
      return !is_done();
    });
  }

  void run_in_lock_step() {
    while (!stop_requested.load() && !is_done() && !is_abandoned(monotonic_ns())) {
      socket_.wait(in_.holds_any() || out_.holds_any() ? 1e-3 : 0.1);
      serve(monotonic_ns());
    }
  }

  const Drive& drive() const { return drive_; }

 private:
  /// Largest number of periods that a delayed process makes up for. The rest is lost
  /// for simulated time.
  static constexpr double kMaxCatchUpPeriods = 200;
  static constexpr int kMaxDatagrams = 512;
  static constexpr std::int64_t kAbandoned_ns = 10'000'000'000;

  void serve(std::int64_t now) {
    const auto handle = [&](const FaultyLink::Datagram& datagram) {
      Drive::Answer answer;
      bool from_host = false;
      drive_.receive(datagram.view(), now, answer, from_host);
      kill_if_due();
      if (from_host) {
        host_ = datagram.peer;
        heard_ns_ = now;
      }
      send(answer, datagram.peer);
    };
    in_.release_due(now, handle);
    out_.release_due(now,
                     [&](const FaultyLink::Datagram& d) { socket_.send_to(d.view(), d.peer); });
    FaultyLink::Datagram datagram;
    for (int i = 0; i < kMaxDatagrams; ++i) {
      const auto got = socket_.receive(datagram.bytes, datagram.size, datagram.peer);
      if (got == UdpSocket::Outcome::kNothing) break;
      // If an earlier host is gone, the socket reports this once.
      if (got == UdpSocket::Outcome::kGone) continue;
      // A datagram that is too long is shortened here. It is still refused because of its size.
      datagram.size = std::min(datagram.size, datagram.bytes.size());
      in_.pass(datagram, drive_.session_time_s(), now, handle);
    }
  }

  void send(const Drive::Answer& answer, const Endpoint& to) {
    if (answer.size == 0) return;
    FaultyLink::Datagram datagram;
    std::copy(answer.view().begin(), answer.view().end(), datagram.bytes.begin());
    datagram.size = answer.size;
    datagram.peer = to;
    out_.pass(datagram, drive_.session_time_s(), monotonic_ns(),
              [&](const FaultyLink::Datagram& d) { socket_.send_to(d.view(), d.peer); });
  }

  void kill_if_due() const {
    if (!drive_.kill_is_due()) return;
    // The record is written for inspection now, because a killed process writes nothing more.
    (void)write_record(record_, drive_.report());
    ::raise(SIGKILL);
  }
  bool is_last() const { return sessions_ > 0 && drive_.report().sessions >= sessions_; }
  bool is_done() const { return is_last() && !drive_.in_session(); }
  /// Lock-step: the host of the last session is silent, and its port is free again, because it was
  /// killed. The host of a paused session is silent, too, but holds its port. The ports of another
  /// computer cannot be asked for, so a host there is waited for.
  bool is_abandoned(std::int64_t now) const {
    return is_last() && now - heard_ns_ > kAbandoned_ns && UdpSocket::listen(host_);
  }

  Drive drive_;
  UdpSocket socket_;
  FaultyLink in_, out_;
  Endpoint host_;
  std::int64_t heard_ns_ = 0;  ///< time of the host's last accepted command
  std::uint64_t sessions_;
  std::string record_;
  double period_s_;
  double periods_behind_ = 0;  ///< number of periods by which simulated time is late
};

nlohmann::json summarize(const Arguments& arguments, const Drive& drive,
                         const RealtimeReport& realtime) {
  const DriveReport& report = drive.report();
  const SimulatedTruth& truth = drive.model().truth();
  nlohmann::json refused = nlohmann::json::object(), peaks = nlohmann::json::array();
  for (std::size_t i = 1; i < kLinkRefusals; ++i)
    refused[to_string(static_cast<LinkRefusal>(i))] = report.packets.by_refusal[i];
  for (const ForcePeak& peak : report.peaks)
    peaks.push_back({{"t_s", peak.t_s}, {"force_N", peak.force_N}});
  return {{"program", "trocar-device-sim " TROCAR_VERSION},
          {"clock", arguments.drive.clock == LinkClock::kReal ? "real" : "lock-step"},
          {"model", arguments.is_full ? "full" : "light"},
          {"rate_Hz", arguments.rate_Hz},
          {"sessions", report.sessions},
          {"packets", {{"accepted", report.packets.accepted()}, {"refused", refused}}},
          {"commands_missed", report.commands_missed},
          {"stale_commands", report.stale_commands},
          {"watchdog_trips", report.watchdog_trips},
          {"emergency_stops", report.emergency_stops},
          {"torque_max_Nm", report.largest_torque_Nm},
          {"hand_force_max_N", report.largest_hand_force_N},
          {"hand_peaks", peaks},
          {"session_time_s", truth.t_s},
          {"energy_J",
           {{"kinetic", truth.kinetic_J},
            {"by_hand", truth.work.hand_J},
            {"by_motors", truth.work.motors_J},
            {"by_friction", truth.work.friction_J},
            {"by_gravity", truth.work.gravity_J},
            {"by_stops", truth.work.stop_J}}},
          {"realtime_priority", realtime.fifo},
          {"missed_deadlines", realtime.missed_deadlines},
          {"wake_us",
           {{"p50", realtime.wake.quantile_us(0.5)},
            {"p99", realtime.wake.quantile_us(0.99)},
            {"p999", realtime.wake.quantile_us(0.999)},
            {"max", realtime.wake.max_us()}}}};
}

int serve(const Arguments& arguments) {
  const OutputFile outputs[] = {{"--summary", arguments.summary}, {"--record", arguments.record}};
  const std::filesystem::path inputs[] = {arguments.scene, arguments.description,
                                          arguments.key_file};
  if (const Result<void> good = check_outputs(outputs, inputs); !good) return fail(good.error());
  DriveOptions options = arguments.drive;
  options.period_s = 1 / arguments.rate_Hz;
  options.record_steps = arguments.record.empty() ? 0 : kMaxRecordedSteps;
  if (const auto ok = parse_fault_plan(arguments.faults).into(options.faults); !ok)
    return fail(ok.error());
  const Result<Endpoint> local = parse_endpoint(arguments.listen, 0);
  if (!local) return fail(usage("--listen " + local.error().message));
  Result<SimulatedDevice> model = load_model(arguments);
  if (!model) return fail(model.error());
  if (const auto ok = load_key(arguments, *local).into(options.key); !ok) return fail(ok.error());
  Result<UdpSocket> socket = UdpSocket::listen(*local);
  if (!socket) return fail(socket.error());

  print(stdout, "ready on %s\n", to_string(socket->local()));
  std::fflush(stdout);
  Server server(options, std::move(*model), std::move(*socket), arguments);
  RealtimeReport realtime;
  if (options.clock == LinkClock::kReal)
    realtime = server.run_real();
  else
    server.run_in_lock_step();
  const DriveReport& report = server.drive().report();
  if (!arguments.quiet) {
    std::printf(
        "%llu sessions, %llu packets accepted, %llu refused; largest force on the hand %.3f N\n",
        static_cast<unsigned long long>(report.sessions),
        static_cast<unsigned long long>(report.packets.accepted()),
        static_cast<unsigned long long>(report.packets.refused()), report.largest_hand_force_N);
    if (!realtime.note.empty()) print(stderr, "trocar-device-sim: note: %s\n", realtime.note);
  }
  if (const auto done = write_record(arguments.record, report); !done) return fail(done.error());
  if (!arguments.summary.empty()) {
    const std::string text = json_text(summarize(arguments, server.drive(), realtime), 2) + "\n";
    if (const auto done = write_file_atomically(arguments.summary, text); !done)
      return fail(done.error());
  }
  return 0;
}

int run_command_line(int argc, char** argv) {
  Arguments arguments;
  CLI::App line(
      "Simulates the four-legged haptic device in a process of its own. trocar-run connects to\n"
      "this process with its option --device udp:HOST:PORT.",
      kName);
  add_help(line, "trocar-device-sim " TROCAR_VERSION " (" + library_versions() + ", libsodium)");
  declare(line, arguments);
  if (const auto done = parse_or_end(line, {argv, argv + argc})) return *done;
  if (arguments.mechanics.encoder_noise_rad > 0 && !arguments.is_full)
    return fail(usage("--encoder-noise: needs --model full"));
  stop_on_signals();
  return serve(arguments);
}

}  // namespace
}  // namespace trocar::runtime

int main(int argc, char** argv) {
  using namespace trocar::runtime;
  return trocar::run_program(kName, [&] { return run_command_line(argc, argv); });
}
