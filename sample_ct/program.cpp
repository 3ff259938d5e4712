// SPDX-License-Identifier: Apache-2.0
#include "sample_ct/program.h"

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <charconv>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "formats/base/nearest_name.h"
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

int fail(const Error& error) {
  std::fprintf(stderr, "trocar-sample-ct: %s\n", error.message.c_str());
  return static_cast<int>(error.code);
}

std::atomic<bool> stop_requested = false;
static_assert(std::atomic<bool>::is_always_lock_free);

// A wish to stop is heard between two pieces of work, so that nothing is left behind; a write
// beyond `ulimit -f` fails instead.
void handle_signals() {
  struct sigaction action {};
  action.sa_handler = [](int) { stop_requested = true; };
  for (const int signal : {SIGINT, SIGTERM, SIGHUP})
    ::sigaction(signal, &action, nullptr);
  std::signal(SIGXFSZ, SIG_IGN);
}

int run(const Arguments& arguments) {
  handle_signals();
  const Result<ScanGeometry> geometry = sample_geometry(arguments.size, arguments.slices);
  if (!geometry) return fail(geometry.error());

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

}  // namespace

int run_sample_ct(int argc, const char* const* argv) {
  try {
    Arguments arguments;
    CLI::App app{
        "Writes a synthetic CT of a lumbar vertebra to OUTDIR: png/ (24-bit grey),\n"
        "dicom/ (a CT series), sample.nii.gz (all three the same scan) and sample.json.",
        "trocar-sample-ct"};
    app.add_option("OUTDIR", arguments.folder, "where to write; made if need be")->required();
    // CLI11 2.1 takes -1 and 1e99 for 2^64 - 1, and nan for a number in every range.
    const CLI::Validator whole(
        [](std::string& text) {
          std::uint64_t value = 0;
          const char* end = text.data() + text.size();
          const auto [rest, error] = std::from_chars(text.data(), end, value);
          return error == std::errc() && rest == end
                     ? std::string()
                     : "\"" + text + "\" is not a whole number of 0 .. 2^64 - 1";
        },
        "");
    const CLI::Validator a_number(
        [](std::string& text) {
          return text.find_first_of("nN") == std::string::npos ? std::string()
                                                               : "\"" + text + "\" is not a number";
        },
        "");
    app.add_option("--seed", arguments.seed, "of textures, noise and UIDs")
        ->capture_default_str()
        ->check(whole);
    app.add_option("--slices", arguments.slices, "number of slices, 1 mm apart")
        ->capture_default_str()
        ->check(CLI::Range(kMinSlices, kMaxSlices));
    app.add_option("--size", arguments.size, "pixels along each side of the 160 mm field of view")
        ->capture_default_str()
        ->check(CLI::Range(kMinSize, kMaxSize));
    app.add_option("--noise-hu", arguments.noise_hu, "standard deviation of the noise, HU")
        ->capture_default_str()
        ->check(a_number)
        ->check(CLI::Range(0.0, kMaxNoise_hu));
    app.add_option("--jobs", arguments.jobs, "threads, 0: all cores; does not change the output")
        ->capture_default_str()
        ->check(CLI::Range(0, 1024));
    app.add_flag("--quiet", arguments.quiet, "print nothing but errors");
    app.set_version_flag("--version", "trocar-sample-ct " TROCAR_VERSION " (" +
                                          png_library_version() + ", " + dicom_library_version() +
                                          ", " + nifti_library_version() + ")");
    try {
      app.parse(argc, argv);
    } catch (const CLI::CallForHelp&) {
      std::fputs(app.help().c_str(), stdout);
      return static_cast<int>(ExitCode::kDone);
    } catch (const CLI::CallForVersion& version) {
      std::printf("%s\n", version.what());
      return static_cast<int>(ExitCode::kDone);
    } catch (const CLI::ExtrasError&) {
      return fail(usage(unexpected_word(app)));
    } catch (const CLI::ParseError& error) {
      return fail(usage(std::string(error.what()) +
                        "; usage: trocar-sample-ct OUTDIR [OPTIONS], --help lists them"));
    }
    return run(arguments);
  } catch (const std::exception& error) {
    return fail(bug(std::string("internal error: ") + error.what()));
  }
}

}  // namespace trocar::sample
