// SPDX-License-Identifier: Apache-2.0
// What the programs of this folder do alike: words in, one line for what is wrong, an exit code
// out, and signals that end them in good order. For their .cpp files only.
#pragma once

#include <CLI/CLI.hpp>
#include <atomic>
#include <csignal>
#include <cstdio>
#include <exception>
#include <optional>
#include <string>

#include "formats/base/nearest_name.h"
#include "formats/base/result.h"
#include "formats/base/standard_output.h"

namespace trocar::runtime {

/// Set by SIGINT, SIGTERM and SIGHUP.
inline std::atomic<bool> stop_requested{false};
static_assert(std::atomic<bool>::is_always_lock_free);  // it is set in a signal handler

/// From now on they ask for an end instead of making one.
inline void stop_on_signals() {
  struct sigaction action {};
  action.sa_handler = [](int) { stop_requested.store(true); };
  for (const int signal : {SIGINT, SIGTERM, SIGHUP})
    ::sigaction(signal, &action, nullptr);
}

/// Says so, and gives the exit code.
inline int fail(const char* program, const Error& error) {
  std::fprintf(stderr, "%s: %s\n", program, error.message.c_str());
  return static_cast<int>(error.code);
}

/// Reads the words into what was declared to `app`. Gives the exit code if that is all there is to
/// do: help, `version`, or a word that cannot be taken. An empty value, as an unset variable of a
/// shell leaves it, is none.
inline std::optional<int> parse_words(CLI::App& app, int count, char** words,
                                      const std::string& version) {
  const std::string name = app.get_name();
  if (const std::string empty = empty_value(count, words); !empty.empty())
    return fail(name.c_str(), usage(empty));
  try {
    app.parse(count, words);
  } catch (const CLI::CallForHelp&) {
    std::fputs(app.help().c_str(), stdout);
    return 0;
  } catch (const CLI::CallForVersion&) {
    std::puts(version.c_str());
    return 0;
  } catch (const CLI::ExtrasError&) {
    return fail(name.c_str(), usage(unexpected_word(app)));
  } catch (const CLI::ParseError& error) {
    return fail(name.c_str(), usage(std::string(error.what()) + "; see " + name + " --help"));
  }
  return std::nullopt;
}

/// main(): what gets past `program_main` is a bug of ours. A closed pipe, or a file beyond the size
/// that the user allows, is an error of write() and no signal.
template <typename Main>
int run_program(const char* name, int count, char** words, const Main& program_main) {
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
  try {
    return after_printing(name, program_main(count, words));
  } catch (const std::exception& failure) {
    std::fprintf(stderr, "%s: unexpected: %s\n", name, failure.what());
    return static_cast<int>(ExitCode::kBug);
  }
}

}  // namespace trocar::runtime
