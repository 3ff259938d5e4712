// SPDX-License-Identifier: GPL-3.0-or-later
// The program trocar-archive, to which trocar-mesh hands the commands `receive` and `fetch`.
#include <new>

#include "formats/base/command_line.h"
#include "formats/base/program.h"
#include "pipeline/archive/messages.h"
#include "pipeline/base/malloc_tuning.h"
#include "pipeline/program/archive/archive_options.h"
#include "pipeline/program/archive/fetch_command.h"
#include "pipeline/program/archive/receive_command.h"
#include "pipeline/read/dicom/dicom_dictionary.h"

namespace trocar::pipeline {
namespace {

int run(int argc, char** argv) {
  // Messages name trocar-mesh, because that is the program that the user has started.
  CommandLine line(archive::kProgram,
                   "Exchanges studies with a DICOM archive; trocar-mesh runs this program.", "");
  line.require_command();
  ReceiveArguments received;
  FetchArguments fetched;
  add_receive_options(line.add_command("receive", kReceiveHelp), received);
  add_fetch_options(line.add_command("fetch", kFetchHelp), fetched);
  if (const auto done = line.parse_or_end({argv, argv + argc})) return *done;
  // Lack of memory is caused by the input and is not a bug.
  try {
    return line.chosen_command() == "receive" ? run_receive(received) : run_fetch(fetched);
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
