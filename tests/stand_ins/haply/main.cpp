// SPDX-License-Identifier: Apache-2.0
// A stand-in for the service of the Haply Inverse3 arm, for tests and for trying a session without the arm. It is
// written from the public description of the protocol alone.
#include <sched.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "tests/stand_ins/haply/server.h"

namespace {

namespace stand_in = trocar::haply_stand_in;

struct CommandLine {
  stand_in::ServiceSettings service;
  std::uint16_t port = 10001;
  std::optional<double> duration_s, force_gate;
  std::string path;
  std::vector<std::string> faults;
};

void declare(CLI::App& app, CommandLine& line) {
  using stand_in::Grip;
  using stand_in::Protocol;
  auto& service = line.service;
  app.add_option("--port", line.port, "Port on 127.0.0.1; 0: any free one")->capture_default_str();
  app.add_option("--duration", line.duration_s, "End after this many seconds")
      ->check(CLI::Range(0.0, 1e9));
  app.add_option("--protocol", service.dialect.protocol, "Version: 3.1 or 3.5 (default)")
      ->transform(CLI::Transformer(
          std::map<std::string, Protocol>{{"3.1", Protocol::kV31}, {"3.5", Protocol::kV35}}));
  app.add_flag("--accept-both", service.dialect.accepts_both,
               "Take forces in the spellings of both versions");
  app.add_option("--device-id", service.dialect.device_id, "Id of the arm")->capture_default_str();
  app.add_flag("--second-device", service.has_second_device,
               "Show a second arm, which never moves");
  app.add_option("--handedness", service.handedness, "left or right")
      ->check(CLI::IsMember({"left", "right"}))
      ->capture_default_str();
  app.add_option("--grip", service.grip, "none (default), verse_grip or wireless")
      ->transform(CLI::Transformer(std::map<std::string, Grip>{
          {"none", Grip::kNone}, {"verse_grip", Grip::kVerseGrip}, {"wireless", Grip::kWireless}}));
  app.add_flag("--numbered-buttons", service.numbers_buttons,
               "Call the buttons of a wireless grip button_0.. instead of a, b, c");
  app.add_option(
         "--force-gate", line.force_gate,
         "Gain of the force filter of a new session, from 0 (off) to less than 1; only with "
         "version 3.5 (default 0.3)")
      ->check(CLI::Range(0.0, 0.999));
  app.add_option("--force-limit", service.force_limit_N, "Forces above this one are counted, N")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  app.add_option("--path", line.path, "Keyframes of the hand (JSON)");
  auto& arm = service.arm;
  app.add_option("--mass", arm.mass_kg, "Mass of the arm, kg")
      ->check(CLI::Range(0.001, 100.0))
      ->capture_default_str();
  app.add_option("--damping", arm.damping_N_s_per_m, "Damping of the arm, N*s/m")
      ->check(CLI::Range(0.0, 1e4))
      ->capture_default_str();
  app.add_option("--hand-stiffness", arm.hand_stiffness_N_per_m, "Stiffness of the hand, N/m")
      ->check(CLI::Range(0.0, 1e5))
      ->capture_default_str();
  app.add_option("--hand-damping", arm.hand_damping_N_s_per_m, "Damping of the hand, N*s/m")
      ->check(CLI::Range(0.0, 1e4))
      ->capture_default_str();
  app.add_option("--idle-after", arm.idle_after_s, "A force ends after this silence, s")
      ->check(CLI::Range(0.0, 1e3))
      ->capture_default_str();
  app.add_option("--log", service.log, "Write all forces to this CSV file");
  app.add_option("--summary", service.summary, "Write counts to this JSON file at the end");
  app.add_option("--fault", line.faults,
                 "KIND@SECONDS[:DURATION], after the first force; without DURATION for one answer. "
                 "Repeatable");
  app.footer("Kinds of faults:\n" + stand_in::fault_help());
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Stand-in for the service of the Haply Inverse3 arm");
  CommandLine line;
  auto& service = line.service;
  service.dialect.device_id = "049D";
  declare(app, line);
  CLI11_PARSE(app, argc, argv);
  try {
    const bool is_new = service.dialect.protocol == stand_in::Protocol::kV35;
    if (line.force_gate && !is_new)
      throw std::runtime_error("--force-gate needs --protocol 3.5: version 3.1 states no filters");
    service.force_gate_gain = is_new ? line.force_gate.value_or(0.3) : 0;
    service.keyframes = {{0, {0, -0.12, 0.15}, {}, 0}};
    if (!line.path.empty()) service.keyframes = stand_in::read_keyframes(line.path);
    for (const std::string& fault : line.faults)
      service.faults.push_back(stand_in::parse_fault(fault));
    stand_in::Service running(service);
    // A real service waits for nobody, so the stand-in takes realtime priority if it may.
    sched_param priority{};
    priority.sched_priority = 70;
    static_cast<void>(::sched_setscheduler(0, SCHED_FIFO, &priority));
    stand_in::serve(running, line.port, line.duration_s);
    running.finish();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
  return 0;
}
