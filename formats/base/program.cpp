// SPDX-License-Identifier: Apache-2.0
#include "formats/base/program.h"

#include <csignal>
#include <cstdio>
#include <exception>

#include "formats/base/standard_output.h"
#include "formats/base/terminal_text.h"

namespace trocar {

std::atomic<bool> stop_requested{false};

void stop_on_signals() {
  struct sigaction action {};
  action.sa_handler = [](int) { stop_requested.store(true); };
  for (const int signal : {SIGINT, SIGTERM, SIGHUP})
    ::sigaction(signal, &action, nullptr);
}

int report_error(const std::string& program, const Error& error) {
  print(stderr, "%s: %s\n", program, error.message);
  return static_cast<int>(error.code);
}

int run_program(const std::string& program, const std::function<int()>& body) {
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
  try {
    return finish_output(program.c_str(), body());
  } catch (const std::exception& failure) {
    return report_error(program, bug(std::string("internal error: ") + failure.what()));
  }
}

}  // namespace trocar
