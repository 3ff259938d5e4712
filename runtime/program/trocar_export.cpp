// SPDX-License-Identifier: Apache-2.0
// trocar-export: writes a recording as HDF5 (runtime/hdf5). It is a program of its own, so that trocar-run does not need libhdf5;
// `trocar-run export` starts it.
// Tests: tests/e2e/hdf5_export_test.py
#include <cstdio>
#include <filesystem>
#include <string>

#include "formats/base/command_line.h"
#include "formats/base/file_io.h"
#include "formats/base/program.h"
#include "formats/base/terminal_text.h"
#include "formats/session/recording.h"
#include "runtime/hdf5/hdf5_file.h"
#include "runtime/hdf5/recording_hdf5.h"
#include "runtime/program/export_command.h"

namespace trocar::runtime {
namespace {

Result<void> convert(const ExportArguments& a) {
  const OutputFile outputs[] = {{"-o", a.output}};
  const std::filesystem::path inputs[] = {a.recording};
  if (auto good = check_outputs(outputs, inputs); !good) return good;
  const Result<std::vector<std::uint8_t>> csv = read_file(a.recording, kMaxRecordingBytes);
  if (!csv) return csv.error();
  const Result<RecordingHdf5> made =
      recording_hdf5({reinterpret_cast<const char*>(csv->data()), csv->size()}, a.recording);
  if (!made) return made.error();
  if (stop_requested.load()) return refused("stopped; nothing was written");
  if (auto written = write_file_atomically(a.output, made->bytes, Readers::kOwner); !written)
    return written;
  if (!a.quiet)
    print(stdout, "%s: %zu ticks, %zu datasets, %zu bytes\n", a.output, made->ticks, made->datasets,
          made->bytes.size());
  return {};
}

int run_command_line(const std::string& name, int argc, char** argv) {
  ExportArguments a;
  CommandLine line(name, "Writes a recording of trocar-run as an HDF5 file.",
                   "trocar-export " TROCAR_VERSION " (HDF5 " + hdf5_version() + ", " +
                       command_line_library() + ")");
  declare_export_options(line, a);
  line.set_footer(
      "Each quantity becomes a dataset; its unit and coordinate frame are attributes. Every\n"
      "number is kept bit for bit.\n"
      "Exit codes: 0 done; 2 wrong usage; 3 input refused; 4 the file could not be written; 1 a "
      "bug.");
  if (const auto done = line.parse_or_end({argv, argv + argc})) return *done;
  stop_on_signals();
  if (const auto done = convert(a); !done) return report_error(name, done.error());
  return 0;
}

}  // namespace
}  // namespace trocar::runtime

int main(int argc, char** argv) {
  // trocar-run starts this program under its own name, which messages then have.
  const std::string name =
      argc > 0 ? std::filesystem::path(argv[0]).filename().string() : "trocar-export";
  return trocar::run_program(name,
                             [&] { return trocar::runtime::run_command_line(name, argc, argv); });
}
