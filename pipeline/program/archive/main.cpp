// SPDX-License-Identifier: GPL-3.0-or-later
// The program trocar-archive, to which trocar-mesh hands the commands `receive` and `fetch`.
// Tests: tests/e2e/archive_receive_test.py, tests/e2e/archive_fetch_test.py
#include <CLI/CLI.hpp>
#include <new>

#include "formats/base/command_line.h"
#include "pipeline/archive/messages.h"
#include "pipeline/base/malloc_tuning.h"
#include "pipeline/program/archive/archive_options.h"
#include "pipeline/program/archive/fetch_command.h"
#include "pipeline/program/archive/receive_command.h"
#include "pipeline/read/dicom/dicom_dictionary.h"

namespace trocar::pipeline {
namespace {

int run(int argc, char** argv) {
  CLI::App app("Exchanges studies with a DICOM archive; trocar-mesh runs this program.");
  app.name(archive::kProgram);  // so that messages name the program that the user has started
  app.require_subcommand(1);
  ReceiveArguments received;
  FetchArguments fetched;
  CLI::App* const receive = app.add_subcommand("receive");
  add_receive_options(*receive, received);
  add_fetch_options(*app.add_subcommand("fetch"), fetched);
  if (const auto done = parse_command_line(app, argc, argv)) return *done;
  // Lack of memory is caused by the input and is not a bug.
  try {
    return receive->parsed() ? run_receive(received) : run_fetch(fetched);
  } catch (const std::bad_alloc&) {
    return report_error(archive::kProgram, refused_for_now("not enough memory for this study"));
  }
}

}  // namespace
}  // namespace trocar::pipeline

int main(int argc, char** argv) {
  trocar::pipeline::keep_freed_memory();
  trocar::pipeline::leave_out_dicom_dictionary();
  return trocar::run_program(trocar::archive::kProgram,
                             [&] { return trocar::pipeline::run(argc, argv); });
}
