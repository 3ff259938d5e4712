// SPDX-License-Identifier: GPL-3.0-or-later
// trocar-mesh: from a scan to an asset; and verify, info, export for assets.
#include <oneapi/tbb/version.h>
#include <unistd.h>
#include <csignal>

#include <CLI/CLI.hpp>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <opencv2/core/version.hpp>

#include "formats/asset.h"
#include "formats/file_io.h"
#include "formats/json_text.h"
#include "formats/nearest_name.h"
#include "formats/standard_output.h"
#include "pipeline/asset_tools.h"
#include "pipeline/batch.h"

namespace {

using namespace trocar;
using namespace trocar::pipeline;
using nlohmann::json;
namespace fs = std::filesystem;

constexpr const char* kVersion = "trocar-mesh " TROCAR_VERSION " (OpenCV " CV_VERSION
                                 ", oneTBB " TBB_VERSION_STRING ", CLI11 " CLI11_VERSION ")";

int fail(const Error& error) {
  std::cerr << "trocar-mesh: " << error.message << '\n';
  return static_cast<int>(error.code);
}

struct Arguments {
  std::vector<fs::path> inputs;
  fs::path output, report, dump_stages;
  double threshold = 226, equalize = 230, tolerance_mm = 0.25, min_angle_deg = 30,
         max_area_mm2 = 50, min_region_mm2 = 1;
  std::vector<int> labels;
  std::string contour = "subpixel", axis = "transverse", preset, series, spacing, slices, crop;
  int lattice_bits = 8, jobs = 0, dump_slice = -1;
  bool quiet = false;
  CLI::Option *threshold_given = nullptr, *equalize_given = nullptr, *labels_given = nullptr,
              *contour_given = nullptr, *area_given = nullptr;
};

// The numbers of "A:B", "X,Y,Z", "X0:X1,Y0:Y1", all of them and nothing else.
template <typename T>
Result<std::vector<T>> numbers(const std::string& text, std::string_view pattern,
                               const std::string& option) {
  std::vector<T> out;
  std::istringstream in(text);
  for (const char c : pattern) {
    if (c == '#') {
      T value{};
      if (!(in >> value)) break;
      out.push_back(value);
    } else if (in.get() != c) {
      break;
    }
  }
  if (in.fail() || in.peek() != std::char_traits<char>::eof() ||
      out.size() != static_cast<std::size_t>(std::count(pattern.begin(), pattern.end(), '#'))) {
    std::string like(pattern);
    std::replace(like.begin(), like.end(), '#', 'N');
    return usage(option + " " + text + ": expected " + like);
  }
  return out;
}

Result<BatchOptions> batch_options(const Arguments& a) {
  // CLI11 2.1 takes nan for a number in every range.
  for (const double v : {a.threshold, a.equalize, a.tolerance_mm, a.min_angle_deg, a.max_area_mm2,
                         a.min_region_mm2}) {
    if (!std::isfinite(v)) return usage("an option's value is not a finite number");
  }
  BatchOptions out;
  const bool paper = a.preset == "paper";
  if (a.labels_given->count() > 0) {
    if (a.threshold_given->count() + a.equalize_given->count() > 0 || paper)
      return usage("--labels goes with neither --threshold, --equalize nor --preset paper");
    out.mesh.segmentation = Labels{{a.labels.begin(), a.labels.end()}};
  } else if (a.equalize_given->count() > 0 || paper) {
    if (a.threshold_given->count() > 0)
      return usage("--threshold and --equalize (or --preset paper) exclude each other");
    out.mesh.segmentation = Equalize{a.equalize};
  } else {
    out.mesh.segmentation = Threshold{a.threshold};
  }
  const bool pixel = a.contour_given->count() > 0 ? a.contour == "pixel" : paper;
  out.mesh.contour = pixel ? ContourKind::kPixel : ContourKind::kSubpixel;
  out.mesh.simplification.tolerance_mm = a.tolerance_mm;
  out.mesh.refinement.min_angle_deg = a.min_angle_deg;
  out.mesh.refinement.max_area_mm2 = a.max_area_mm2;
  if (paper && a.area_given->count() == 0) out.mesh.max_area_px2 = 200;
  out.mesh.min_region_mm2 = a.min_region_mm2;
  out.mesh.lattice.bits = a.lattice_bits;
  out.threads = a.jobs;
  if (!a.slices.empty()) {
    const auto n = numbers<int>(a.slices, "#:#", "--slices");
    if (!n) return n.error();
    out.slices = std::pair{(*n)[0], (*n)[1]};
  }
  if (!a.crop.empty()) {
    const auto n = numbers<int>(a.crop, "#:#,#:#", "--crop");
    if (!n) return n.error();
    out.mesh.crop = Crop{(*n)[0], (*n)[1], (*n)[2], (*n)[3]};
  }
  if (a.dump_slice >= 0) out.dump_slice = a.dump_slice;
  return out;
}

json parameters_json(const BatchOptions& o, const OpenOptions& input) {
  json out = {{"contour", o.mesh.contour == ContourKind::kPixel ? "pixel" : "subpixel"},
              {"tolerance_mm", o.mesh.simplification.tolerance_mm},
              {"min_angle_deg", o.mesh.refinement.min_angle_deg},
              {"min_region_mm2", o.mesh.min_region_mm2},
              {"lattice_bits", o.mesh.lattice.bits}};
  if (o.mesh.max_area_px2) {
    out["max_area_px2"] = *o.mesh.max_area_px2;
  } else {
    out["max_area_mm2"] = o.mesh.refinement.max_area_mm2;
  }
  if (const auto* t = std::get_if<Threshold>(&o.mesh.segmentation)) out["threshold"] = t->value;
  if (const auto* e = std::get_if<Equalize>(&o.mesh.segmentation)) out["equalize"] = e->level;
  if (const auto* l = std::get_if<Labels>(&o.mesh.segmentation)) out["labels"] = l->labels;
  if (o.slices) out["slices"] = {o.slices->first, o.slices->second};
  if (o.mesh.crop)
    out["crop"] = {o.mesh.crop->x0, o.mesh.crop->x1, o.mesh.crop->y0, o.mesh.crop->y1};
  if (input.spacing_mm) out["spacing_mm"] = *input.spacing_mm;
  if (!input.series_uid.empty()) out["series"] = input.series_uid;
  if (input.axis != SliceAxis::kTransverse)
    out["axis"] = input.axis == SliceAxis::kCoronal ? "coronal" : "sagittal";
  return out;
}

// Nothing that was read, or could be a scan, is written over: `-o *.png` makes a slice the output.
Result<void> check_outputs(const Arguments& a, const std::vector<fs::path>& read) {
  const OutputFile outputs[] = {
      {"-o", a.output}, {"--report", a.report}, {"--dump-stages", a.dump_stages}};
  for (const OutputFile& output : outputs) {
    if (!output.file.empty() && is_scan_file(output.file))
      return usage(output.option + " " + output.file.string() + ": would write over a scan");
  }
  return trocar::check_outputs(outputs, read);
}

std::atomic<bool> stop_requested = false;
static_assert(std::atomic<bool>::is_always_lock_free);

void request_stop(int) {
  stop_requested = true;
}

// A bar with the time left.
std::function<void(int, int)> progress_bar() {
  return [start = std::chrono::steady_clock::now()](int done, int total) {
    constexpr int kWidth = 30;
    const double spent =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    std::string bar(static_cast<std::size_t>(kWidth * done / total), '#');
    bar.resize(kWidth, '.');
    std::fprintf(stderr, "\r  [%s] slice %d of %d, %.0f s left %s", bar.c_str(), done, total,
                 spent / done * (total - done), done == total ? "\n" : "");
  };
}

int mesh(const Arguments& a) {
  if (a.inputs.empty()) return fail(usage("no INPUT given; see trocar-mesh --help"));
  if (a.output.empty()) return fail(usage("no output given: -o OUT.glb"));
  if (auto ok = check_outputs(a, a.inputs); !ok) return fail(ok.error());
  auto options = batch_options(a);
  if (!options) return fail(options.error());
  OpenOptions open;
  open.series_uid = a.series;
  open.axis = a.axis == "coronal"    ? SliceAxis::kCoronal
              : a.axis == "sagittal" ? SliceAxis::kSagittal
                                     : SliceAxis::kTransverse;
  if (!a.spacing.empty()) {
    const auto n = numbers<double>(a.spacing, "#,#,#", "--spacing");
    if (!n) return fail(n.error());
    for (const double mm : *n) {
      if (!(mm > 1e-6 && mm < 1e6))
        return fail(usage("--spacing " + a.spacing + ": each must be a positive number of mm"));
    }
    open.spacing_mm = {(*n)[0], (*n)[1], (*n)[2]};
  }
  open.as_labels = std::holds_alternative<Labels>(options->mesh.segmentation);
  const auto stack = open_stack(a.inputs, open);
  if (!stack) return fail(stack.error());
  if (auto ok = check_outputs(a, (*stack)->files); !ok) return fail(ok.error());
  if ((*stack)->calibration() == Calibration::kGrey &&
      std::holds_alternative<Threshold>(options->mesh.segmentation) &&
      a.threshold_given->count() == 0) {
    return fail(usage(
        "images carry no HU: give --equalize LEVEL, or --threshold with a grey level of 0..255"));
  }
  if (!a.quiet && ::isatty(STDERR_FILENO) != 0) options->progress = progress_bar();
  options->stop = &stop_requested;
  struct sigaction action {};
  action.sa_handler = request_stop;
  for (const int signal : {SIGINT, SIGTERM, SIGHUP})
    ::sigaction(signal, &action, nullptr);

  auto result = mesh_stack(**stack, *options, parameters_json(*options, open));
  if (!result) return fail(result.error());
  if (!a.dump_stages.empty() && result->stages.is_null())
    return fail(usage("--dump-stages needs --dump-slice with a slice that was meshed"));
  if (auto ok = write_file_atomically(a.output, result->glb); !ok) return fail(ok.error());
  json& report = result->report;
  const auto digest = digest_file(a.output);
  if (!digest) return fail(digest.error());
  report["asset"]["digest"] = *digest;
  report["asset"]["file"] = a.output.string();
  json inputs = json::array();
  for (const fs::path& input : a.inputs)
    inputs.push_back(input.string());
  report["input"] = {{"paths", std::move(inputs)},
                     {"digest", result->input_digest},
                     {"slices", (*stack)->size()},
                     {"width_px", (*stack)->width()},
                     {"height_px", (*stack)->height()}};
  if (!a.report.empty()) {
    if (auto ok = write_file_atomically(a.report, json_text(report, 1) + "\n"); !ok)
      return fail(ok.error());
  }
  if (!a.dump_stages.empty()) {
    if (auto ok = write_file_atomically(a.dump_stages, json_text(result->stages) + "\n"); !ok)
      return fail(ok.error());
  }
  if (!a.quiet) {
    for (const json& w : report["warnings"]) {
      std::cerr << "trocar-mesh: warning (" << w["code"].get<std::string>()
                << "): " << w["where"].get<std::string>() << ": "
                << w["sentence"].get<std::string>() << '\n';
    }
    std::printf("%s: %zu slices, %zu triangles, %zu bytes, %.0f ms\n", a.output.c_str(),
                report["slices"].size(), report["asset"]["triangles"].get<std::size_t>(),
                report["asset"]["bytes"].get<std::size_t>(), report["total_ms"].get<double>());
  }
  return 0;
}

int verify(const fs::path& file, bool as_json) {
  const auto asset = read_asset(file);
  const Result<void> ok = asset ? verify_asset(*asset, file.string()) : Result<void>(asset.error());
  if (as_json) {
    json out = {{"file", file.string()}, {"valid", static_cast<bool>(ok)}};
    if (!ok) out["reason"] = ok.error().message;
    std::cout << json_text(out, 1) << '\n';
  }
  if (!ok) return fail(ok.error());
  if (!as_json) std::printf("%s: valid, %zu slices\n", file.c_str(), asset->slices.size());
  return 0;
}

int info(const fs::path& file, bool as_json) {
  const auto asset = read_asset(file);
  if (!asset) return fail(asset.error());
  std::error_code error;
  const json out = describe_asset(*asset, fs::file_size(file, error));
  if (as_json) {
    std::cout << json_text(out, 1) << '\n';
    return 0;
  }
  std::printf(
      "%s\n  written by %s\n  lattice step 2^-%d mm, %zu triangles, %zu bytes\n  parameters %s\n\n "
      " slice      z mm    rings  vertices  triangles   area mm2\n",
      file.c_str(), asset->generator.c_str(), asset->lattice.bits,
      out["triangles"].get<std::size_t>(), out["bytes"].get<std::size_t>(),
      json_text(out["parameters"]).c_str());
  for (const json& s : out["slices"]) {
    std::printf("  %5d %9.3f %8zu %9zu %10zu %10.2f\n", s["index"].get<int>(),
                s["z_mm"].get<double>(), s["rings"].get<std::size_t>(),
                s["vertices"].get<std::size_t>(), s["triangles"].get<std::size_t>(),
                s["area_mm2"].get<double>());
  }
  return 0;
}

int run(int argc, char** argv) {
  CLI::App app{
      "From a CT scan to an asset of exact triangle meshes, one a slice.\n"
      "INPUT is a folder or list of images, a folder of DICOM files, or a .nii/.nii.gz."};
  app.name("trocar-mesh");
  app.get_formatter()->column_width(46);
  app.set_version_flag("--version", kVersion);
  app.require_subcommand(0, 1);
  Arguments a;
  app.add_option("INPUT", a.inputs, "the scan");
  app.add_option("-o,--output", a.output, "the asset to write (.glb)");
  a.threshold_given =
      app.add_option("--threshold", a.threshold, "iso-value in HU; on images a grey level")
          ->capture_default_str()
          ->check(CLI::Range(-1e6, 1e6));
  a.equalize_given =
      app.add_option("--equalize", a.equalize, "histogram equalisation, then this level")
          ->capture_default_str()
          ->check(CLI::Range(0.0, 255.0));
  a.labels_given = app.add_option("--labels", a.labels, "the input is a label map: these labels")
                       ->delimiter(',')
                       ->allow_extra_args(false);
  a.contour_given = app.add_option("--contour", a.contour, "iso-contour or pixel chains")
                        ->capture_default_str()
                        ->check(CLI::IsMember({"subpixel", "pixel"}));
  app.add_option("--tolerance", a.tolerance_mm, "Douglas-Peucker tolerance, mm")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1e4));
  app.add_option("--min-angle", a.min_angle_deg, "smallest angle, degrees")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 60.0));
  a.area_given = app.add_option("--max-area", a.max_area_mm2, "largest triangle, mm^2")
                     ->capture_default_str()
                     ->check(CLI::Range(1e-6, 1e12));
  app.add_option("--min-region", a.min_region_mm2, "drop smaller islands, fill smaller holes, mm^2")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1e12));
  app.add_option("--spacing", a.spacing, "X,Y,Z in mm, where the input has none");
  app.add_option("--slices", a.slices, "A:B, first and last slice, from 0");
  app.add_option("--crop", a.crop, "X0:X1,Y0:Y1, first and last pixel, from 0");
  app.add_option("--series", a.series, "SeriesInstanceUID, of several in a folder");
  app.add_option("--axis", a.axis, "slices of a volume: transverse, coronal or sagittal")
      ->capture_default_str()
      ->check(CLI::IsMember({"transverse", "coronal", "sagittal"}));
  app.add_option("--preset", a.preset, "paper: equalise, pixel chains, 30 degrees, 200 px^2")
      ->check(CLI::IsMember({"paper"}));
  app.add_option("--lattice-bits", a.lattice_bits, "lattice step 2^-N mm")
      ->capture_default_str()
      ->check(CLI::Range(kMinLatticeBits, kMaxLatticeBits));
  app.add_option("--jobs", a.jobs, "threads; 0 is all cores")
      ->capture_default_str()
      ->check(CLI::Range(0, 1024));
  app.add_option("--report", a.report, "what was done, as JSON");
  app.add_option("--dump-stages", a.dump_stages, "stages of --dump-slice as JSON, for pictures");
  app.add_option("--dump-slice", a.dump_slice, "which slice that is");
  app.add_flag("--quiet", a.quiet, "say nothing but errors");

  fs::path asset, folder;
  bool as_json = false;
  CLI::App* verify_command = app.add_subcommand("verify", "prove an asset's invariants");
  CLI::App* info_command = app.add_subcommand("info", "say what is in an asset");
  CLI::App* export_command =
      app.add_subcommand("export", "write .poly, .obj and .svg, one a slice");
  for (CLI::App* command : {verify_command, info_command, export_command}) {
    command->add_option("ASSET", asset, "the .glb")->required();
  }
  for (CLI::App* command : {verify_command, info_command})
    command->add_flag("--json", as_json, "as JSON");
  export_command->add_option("-o,--output", folder, "the folder to write to")->required();

  try {
    app.parse(argc, argv);
  } catch (const CLI::ExtrasError&) {
    return fail(usage(unexpected_word(app)));
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) return app.exit(e);
    return fail(usage(std::string(e.what()) + " (see trocar-mesh --help)"));
  }
  if (*verify_command) return verify(asset, as_json);
  if (*info_command) return info(asset, as_json);
  if (*export_command) {
    const auto loaded = read_asset(asset);
    if (!loaded) return fail(loaded.error());
    // What is not proved, others need not be able to read.
    if (const auto proved = verify_asset(*loaded, asset.string()); !proved)
      return fail(proved.error());
    const auto ok = export_asset(*loaded, folder);
    return ok ? 0 : fail(ok.error());
  }
  return mesh(a);
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return trocar::after_printing("trocar-mesh", run(argc, argv));
  } catch (const std::bad_alloc&) {
    return fail(refused("not enough memory for this input"));
  } catch (const std::exception& e) {
    return fail(bug(e.what()));
  }
}
