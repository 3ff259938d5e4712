// SPDX-License-Identifier: Apache-2.0
#include "sample_ct/program.h"

#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <string>

#include "formats/base/command_line.h"
#include "sample_ct/render.h"
#include "sample_ct/sample_folder.h"
#include "sample_ct/write_dicom.h"
#include "sample_ct/write_nifti.h"

namespace trocar::sample {
namespace {

struct Arguments {
  std::string folder;
  std::uint64_t seed = 1;
  int slices = 35;
  int size = 512;
  double noise_hu = 12;
  int jobs = 0;
  bool quiet = false;
};

constexpr const char* kName = "trocar-sample-ct";

int fail(const Error& error) {
  return report_error(kName, error);
}

int run(const Arguments& arguments) {
  stop_on_signals();
  const Result<ScanGeometry> geometry = sample_geometry(arguments.size, arguments.slices);
  if (!geometry) return fail(geometry.error());
  if (const Result<void> good = check_sample_folder(arguments.folder); !good)
    return fail(good.error());

  const bool show = !arguments.quiet && ::isatty(STDERR_FILENO) == 1;
  const auto progress = [&](const std::string& what) {
    if (show) std::fprintf(stderr, "\r\033[K%s", what.c_str());
  };
  progress("scanning");
  PhantomOptions phantom;
  phantom.seed = arguments.seed;
  const Scan scan =
      render_scan(phantom, *geometry, arguments.noise_hu, arguments.jobs, &stop_requested);
  const Result<void> written =
      write_sample_folder(scan, GreyWindow{}, arguments.folder, progress, &stop_requested);
  progress("");
  if (!written) return fail(written.error());
  if (!arguments.quiet)
    std::printf("%s: %d slices of %d x %d pixels as png/, dicom/ and sample.nii.gz\n",
                arguments.folder.c_str(), arguments.slices, arguments.size, arguments.size);
  return static_cast<int>(ExitCode::kDone);
}

void declare(CLI::App& command, Arguments& arguments) {
  command.add_option("OUTDIR", arguments.folder, "the folder to write to; created if needed")
      ->required();
  add_number(command, "--seed", arguments.seed, {0, 9e15, "N"},
             "number that determines the random textures, the noise and the UIDs");
  add_number(command, "--slices", arguments.slices, {kMinSlices, kMaxSlices},
             "number of slices, 1 mm apart");
  add_number(command, "--size", arguments.size, {kMinSize, kMaxSize},
             "pixels along each edge of the 160 mm field of view");
  add_number(command, "--noise-hu", arguments.noise_hu, {0.0, kMaxNoise_hu},
             "standard deviation of the noise, HU");
  add_number(command, "--jobs", arguments.jobs, {0, 1024},
             "number of threads, 0: one for each core; the output is the same for any number");
  command.add_flag("--quiet", arguments.quiet, "print errors only");
}

int run_command_line(int argc, const char* const* argv) {
  Arguments arguments;
  CLI::App line(
      "Writes a synthetic CT of a lumbar vertebra to OUTDIR, in three formats: png/ (grey "
      "pictures\n"
      "with three equal channels of 8 bits), dicom/ (a CT series) and sample.nii.gz (NIfTI). Also\n"
      "writes sample.json: the scan's seed, grid and noise, and the bone's HU (grey levels of CT).",
      kName);
  add_help(line, std::string(kName) + " " TROCAR_VERSION " (" + png_library_version() + ", " +
                     dicom_library_version() + ", " + nifti_library_version() + ")");
  declare(line, arguments);
  if (const auto done = parse_or_end(line, {argv, argv + argc})) return *done;
  return run(arguments);
}

}  // namespace

int run_sample_ct(int argc, const char* const* argv) {
  return run_program(kName, [&] { return run_command_line(argc, argv); });
}

}  // namespace trocar::sample
