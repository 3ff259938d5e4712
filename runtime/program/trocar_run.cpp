// SPDX-License-Identifier: Apache-2.0
#include "runtime/program/trocar_run.h"

#include <atomic>
#include <csignal>
#include <string>

#include "formats/base/command_line.h"
#include "runtime/program/library_versions.h"
#include "runtime/program/run_commands.h"
#include "runtime/program/run_options.h"

namespace trocar::runtime {
namespace {

std::atomic<bool> recovery_requested{false};

/// trocar-run without a command runs a session.
struct RunCommandLine {
  CLI::App app{
      "Lets a hand feel the force of tissue on a needle or another tool: a haptic device, a\n"
      "machine with motors, pushes the hand with this force. A session is a run of the haptic\n"
      "loop, which reads the device and computes the force in every tick, by default 1000 times\n"
      "a second.",
      kProgram};
  RunArguments arguments;
  CLI::App *check, *new_scene, *replay, *test, *history, *procedures;

  RunCommandLine() {
    add_help(app, "trocar-run " TROCAR_VERSION " (" + library_versions() +
                      ", Draco and tinygltf for assets)");
    declare_run(app, arguments);
    const auto add = [this](const char* name, const char* help, auto declare, auto& values) {
      CLI::App* const command = app.add_subcommand(name, help);
      declare(*command, values);
      return command;
    };
    check = add("check", "check a scene: path, forces and region, then a dry run with warnings",
                declare_check, arguments);
    new_scene = add("new-scene", "propose a scene for an asset", declare_new_scene, arguments);
    replay =
        add("replay", "compute a recorded session again from its inputs, and compare the torques",
            declare_replay, arguments);
    test = add("test", "read a device without force: would a session run without faults?",
               declare_test, arguments);
    history = add("history", "write the learning curves of a folder of sessions", declare_history,
                  arguments);
    procedures = add("procedures", "print the values of --procedure with their sources",
                     declare_procedures, arguments);
    // A command takes the footer that is set when it is added. This one is for the program alone.
    app.footer(
        "trocar-run COMMAND --help describes a command and its options.\n"
        "Exit codes: 0 done; 2 wrong usage; 3 input refused, or torques of a replay differ, or a\n"
        "warning of check --strict; 4 output not written; 5 device failed, or a fault ended the\n"
        "session, or test found trouble, or a check was interrupted before its result; 1 an\n"
        "internal error. Ctrl-C ends a session with zero torques and complete files.");
  }

  int run() {
    const CLI::App* const command = given_command(app);
    if (command == procedures) return explain_procedures(arguments);
    if (command == history) return write_history(arguments);
    if (command == nullptr) {
      if (arguments.scene.empty()) return fail(usage("SCENE is required (see trocar-run --help)"));
      if (const auto good = check_command(app, arguments.scene); !good) return fail(good.error());
    }
    if (command == check) arguments.task = SceneTask::kCheck;
    if (command == replay) arguments.task = SceneTask::kReplay;
    if (const auto good = check_options(arguments); !good) return fail(good.error());
    stop_on_signals();
    struct sigaction action {};
    action.sa_handler = [](int) { recovery_requested.store(true); };
    ::sigaction(SIGUSR1, &action, nullptr);
    if (command == test) return test_device(arguments);
    return command == new_scene ? make_new_scene(arguments)
                                : run_scene(arguments, recovery_requested);
  }
};

}  // namespace

int trocar_run(int argc, char** argv) {
  return run_program(kProgram, [&] {
    RunCommandLine line;
    const auto done = parse_or_end(line.app, {argv, argv + argc});
    return done ? *done : line.run();
  });
}

}  // namespace trocar::runtime
