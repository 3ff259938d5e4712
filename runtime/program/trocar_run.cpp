// SPDX-License-Identifier: Apache-2.0
#include "runtime/program/trocar_run.h"

#include <array>
#include <atomic>
#include <csignal>
#include <string>
#include <string_view>
#include <utility>

#include "formats/base/command_line.h"
#include "formats/base/program.h"
#include "runtime/program/library_versions.h"
#include "runtime/program/option_effects.h"
#include "runtime/program/run_arguments.h"
#include "runtime/program/run_commands.h"
#include "runtime/program/run_options.h"

namespace trocar::runtime {
namespace {

std::atomic<bool> recovery_requested{false};

/// Commands that are programs of their own.
constexpr std::array kFormerCommands{std::pair{"fit", "trocar-fit"},
                                     std::pair{"export", "trocar-hdf5"}};

int run_command_line(int argc, char** argv) {
  for (const auto& [command, program] : kFormerCommands)
    if (argc > 1 && argv[1] == std::string_view(command))
      return report_error(kProgram, usage(std::string(command) + ": is the program " + program +
                                          "; the Debian package trocar-tools has it"));
  RunArguments arguments;
  CommandLine line(
      kProgram,
      "Lets a hand feel the force of tissue on a needle or another tool: a haptic device, a\n"
      "machine with motors, pushes the hand with this force. A session is a run of the haptic\n"
      "loop, which reads the device and computes the force in every tick, by default 1000 times\n"
      "a second.",
      "trocar-run " TROCAR_VERSION " (" + library_versions() + ", Draco and tinygltf for assets)");
  declare_run_options(line, arguments);
  if (const auto done = line.parse_or_end({argv, argv + argc})) return *done;
  if (const Result<void> good = check_run_arguments(arguments); !good)
    return report_error(kProgram, good.error());
  if (const Result<void> good = check_option_effects(line, arguments); !good)
    return report_error(kProgram, good.error());
  if (arguments.explain) return explain_procedures(arguments);
  if (!arguments.history.empty()) return write_history(arguments);
  stop_on_signals();
  struct sigaction action {};
  action.sa_handler = [](int) { recovery_requested.store(true); };
  ::sigaction(SIGUSR1, &action, nullptr);
  if (arguments.test_device) return test_device(arguments);
  return arguments.new_scene.empty() ? run_scene(arguments, recovery_requested)
                                     : make_new_scene(arguments);
}

}  // namespace

int trocar_run(int argc, char** argv) {
  return run_program(kProgram, [&] { return run_command_line(argc, argv); });
}

}  // namespace trocar::runtime
