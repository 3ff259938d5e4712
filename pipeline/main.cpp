// SPDX-License-Identifier: GPL-3.0-or-later
// trocar-mesh: makes an asset from a scan; its subcommands list scans, preview a run,
// and verify, describe and export assets.
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/info.h>
#include <oneapi/tbb/version.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <chrono>
#include <cstdio>
#include <iostream>
#include <limits>
#include <opencv2/core/version.hpp>
#include <set>

#include "formats/asset/asset.h"
#include "formats/asset/private_asset.h"
#include "formats/base/command_line.h"
#include "formats/base/file_io.h"
#include "formats/base/json_text.h"
#include "formats/base/nearest_name.h"
#include "pipeline/arguments.h"
#include "pipeline/asset_tools.h"
#include "pipeline/batch.h"
#include "pipeline/batch_command.h"
#include "pipeline/keep_memory.h"
#include "pipeline/mesh_scan.h"
#include "pipeline/presets.h"
#include "pipeline/preview.h"
#include "pipeline/preview_file.h"
#include "pipeline/preview_sheet.h"
#include "pipeline/read/dicom_dictionary.h"
#include "pipeline/review_command.h"
#include "pipeline/scan_list.h"
#include "pipeline/second_opinion.h"

namespace {

using namespace trocar;
using namespace trocar::pipeline;
using nlohmann::json;
namespace fs = std::filesystem;

constexpr const char* kVersion = "trocar-mesh " TROCAR_VERSION " (OpenCV " CV_VERSION
                                 ", oneTBB " TBB_VERSION_STRING ", CLI11 " CLI11_VERSION ")";

constexpr const char* kName = "trocar-mesh";

int fail(const Error& error) {
  return report_error(kName, error);
}

std::string ending_of(const fs::path& file) {
  std::string ending = file.extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return ending;
}

// Refuses to overwrite an input or any file that may be a scan: in `-o *.png` the shell makes a
// slice the output.
Result<void> check_outputs(const Arguments& a, const std::vector<fs::path>& read) {
  const OutputFile outputs[] = {
      {"-o", a.output}, {"--report", a.report}, {"--dump-stages", a.dump_stages}};
  for (const OutputFile& output : outputs) {
    if (!output.file.empty() && is_scan_file(output.file))
      return usage(output.option + " " + output.file.string() + ": would write over a scan");
  }
  if (auto ok = trocar::check_outputs(outputs, read); !ok) return ok;
  if (ending_of(a.output) != ".glb") {
    return usage("-o " + a.output.string() +
                 ": an asset is a .glb; trocar-mesh export writes its slices as .poly, .obj, .svg");
  }
  return {};
}

// A sheet replaces no picture but another sheet (in `-o *.png` the shell makes a slice the output),
// and does not become one of the scan's images.
Result<void> check_sheet(const Arguments& a, const std::vector<fs::path>& read) {
  const std::string given = "-o " + a.output.string() + ": ";
  const std::string ending = ending_of(a.output);
  if (ending != ".png" && ending != ".html")
    return usage(given + "a preview is a .png or .html; an asset is made without preview");
  const OutputFile outputs[] = {{"-o", a.output}};
  if (auto ok = trocar::check_outputs(outputs, read); !ok) return ok;
  std::error_code ignored;
  if (ending == ".png" && fs::exists(a.output, ignored) && !is_sheet(a.output))
    return usage(given + "would write over a picture that is no preview");
  if (ending != ".png" || read.empty() || ending_of(read[0]) != ".png") return {};
  const fs::path folder = a.output.has_parent_path() ? a.output.parent_path() : ".";
  const fs::path scan = read[0].has_parent_path() ? read[0].parent_path() : ".";
  if (fs::equivalent(folder, scan, ignored))
    return usage(given + "would become one of the scan's images; give another folder");
  return {};
}

// `--labels 41 42` as `--labels 41 --labels 42`: words after an option's value for which is_value
// holds are values of it, too, and not inputs.
template <typename IsValue>
std::vector<std::string> with_repeated(const std::string& option, const IsValue& is_value,
                                       const std::vector<std::string>& words) {
  std::vector<std::string> out;
  bool after_value = false;
  for (std::size_t i = 0; i < words.size(); ++i) {
    const std::string& word = words[i];
    if (after_value && is_value(word)) {
      out.push_back(option);
    } else {
      after_value = word.starts_with(option + "=");
    }
    out.push_back(word);
    if (word == option && i + 1 < words.size()) {
      out.push_back(words[++i]);
      after_value = true;
    }
  }
  return out;
}

// Labels begin with a digit and hold only digits, commas, hyphens and plus signs.
bool is_labels(const std::string& word) {
  return !word.empty() && word.find_first_not_of("0123456789,-+") == std::string::npos &&
         word.front() >= '0' && word.front() <= '9';
}

bool is_place(const std::string& word) {
  return word.find_first_not_of("0123456789,.+-eE") == std::string::npos &&
         std::count(word.begin(), word.end(), ',') == 2;
}

// A mistyped command is read as an INPUT.
Result<void> check_command(const CLI::App& app, const Arguments& a) {
  if (a.inputs.empty() || a.inputs[0].has_parent_path()) return {};
  std::error_code ignored;
  if (fs::exists(a.inputs[0], ignored)) return {};
  std::vector<std::string> commands;
  for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; }))
    commands.push_back(command->get_name());
  const std::string meant = did_you_mean(a.inputs[0].string(), commands);
  if (meant.empty()) return {};
  return usage(a.inputs[0].string() + ": no such file, folder or command" + meant);
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

// Reports hold no absolute paths and nothing that tells whose scan it is, also not in the warnings.
json to_be_shared(json report, const std::vector<fs::path>& inputs) {
  const auto shorten = [&inputs](json& text) {
    std::string out = text.get<std::string>();
    for (const fs::path& input : inputs) {
      const std::string whole = (input.has_filename() ? input : input.parent_path()).string();
      const std::string name = without_folder(input);
      if (!input.is_absolute() || name.empty()) continue;
      for (std::size_t at = 0; (at = out.find(whole, at)) != std::string::npos; at += name.size())
        out.replace(at, whole.size(), name);
    }
    text = std::move(out);
  };
  for (json& warning : report["warnings"]) {
    if (const auto shared = warning.find("shared"); shared != warning.end()) {
      warning["sentence"] = *shared;
      warning.erase("shared");
    }
    shorten(warning["where"]);
    shorten(warning["sentence"]);
    if (const auto places = warning.find("places"); places != warning.end())
      std::for_each(places->begin(), places->end(), shorten);
  }
  return report;
}

// Adds to the report what it says of the input files and of the asset, which has been written.
Result<void> describe_files(const Arguments& a, const SliceStack& stack, BatchResult& result) {
  const auto digest = digest_file(a.output);
  if (!digest) return digest.error();
  result.report["asset"]["digest"] = *digest;
  result.report["asset"]["file"] = without_folder(a.output);
  json inputs = json::array();
  for (const fs::path& input : a.inputs)
    inputs.push_back(without_folder(input));
  result.report["input"] = {{"paths", std::move(inputs)},
                            {"slices", stack.size()},
                            {"width_px", stack.width()},
                            {"height_px", stack.height()}};
  if (!a.hu.empty()) result.report["input"]["hu"] = without_folder(a.hu);
  if (!result.input_key_digest.empty())
    result.report["input"]["key_digest"] = result.input_key_digest;
  if (stack.series) {
    const SeriesInfo& s = *stack.series;
    // Its UID and description could tell whose scan it is.
    result.report["input"]["series"] = {{"number", s.number ? json(*s.number) : json()},
                                        {"kernel", s.kernel},
                                        {"modality", s.modality}};
  }
  return {};
}

Result<void> write_outputs(const Arguments& a, const SliceStack& stack, BatchResult& result) {
  if (auto ok = write_file_atomically(a.output, result.glb); !ok) return ok;
  if (auto ok = describe_files(a, stack, result); !ok) return ok;
  if (!a.report.empty()) {
    std::vector<fs::path> given = a.inputs;
    if (!a.hu.empty()) given.push_back(a.hu);
    const json report = to_be_shared(result.report, given);
    if (auto ok = write_file_atomically(a.report, json_text(report, 1) + "\n"); !ok) return ok;
  }
  if (!a.dump_stages.empty())
    return write_file_atomically(a.dump_stages, json_text(result.stages) + "\n");
  return {};
}

void print_outcome(const Arguments& a, const json& report) {
  for (const json& w : report["warnings"]) {
    std::cerr << "trocar-mesh: warning (" << w["code"].get<std::string>()
              << "): " << w["where"].get<std::string>() << ": " << w["sentence"].get<std::string>()
              << '\n';
  }
  std::set<int> slices;  // each of several materials has an entry
  for (const json& slice : report["slices"])
    slices.insert(slice["index"].get<int>());
  std::printf("%s: %zu slices, %zu triangles, %zu bytes, %.0f ms\n", a.output.c_str(),
              slices.size(), report["asset"]["triangles"].get<std::size_t>(),
              report["asset"]["bytes"].get<std::size_t>(), report["total_ms"].get<double>());
}

// All that is read: nothing of it may be written over.
std::vector<fs::path> files_read(const Arguments& a, const LabelsWithCt& scan) {
  std::vector<fs::path> out = scan.labels->files;
  if (scan.ct != nullptr) out.insert(out.end(), scan.ct->files.begin(), scan.ct->files.end());
  if (!a.names.empty()) out.emplace_back(a.names);
  return out;
}

int explain(const std::string& preset) {
  const auto text = explain_presets(preset);
  if (!text) return fail(text.error());
  std::fputs(text->c_str(), stdout);
  return 0;
}

int mesh(const Arguments& a) {
  if (a.explain) return explain(a.preset);
  if (a.inputs.empty()) return fail(usage("no INPUT given; see trocar-mesh --help"));
  if (a.output.empty()) return fail(usage("no output given: -o OUT.glb"));
  if (auto ok = check_outputs(a, a.inputs); !ok) return fail(ok.error());
  auto options = batch_options(a);
  if (!options) return fail(options.error());
  auto open = open_options(a);
  if (!open) return fail(open.error());
  open->unpack_behind = true;
  stop_on_signals();
  const auto scan = open_scan(a, *open);
  if (!scan) return fail(scan.error());
  const std::unique_ptr<SliceStack>& stack = scan->labels;
  options->mesh.hu = scan->ct.get();
  if (auto ok = check_outputs(a, files_read(a, *scan)); !ok) return fail(ok.error());
  if (auto ok = check_threshold(a, *stack); !ok) return fail(ok.error());
  if (!a.quiet && ::isatty(STDERR_FILENO) != 0) options->progress = progress_bar();
  options->stop = &stop_requested;
  // A volume that is no DICOM is transverse without --axis, too.
  if (!stack->series && open->axis == SliceAxis::kTransverse) open->axis.reset();
  options->axis = open->axis;
  auto result = mesh_stack(*stack, *options, parameters_json(*options, *open));
  if (!result) return fail(result.error());
  if (!a.dump_stages.empty() && result->stages.is_null())
    return fail(usage("--dump-stages needs --dump-slice with a slice that was meshed"));
  if (auto ok = write_outputs(a, *stack, *result); !ok) return fail(ok.error());
  if (!a.quiet) print_outcome(a, result->report);
  return 0;
}

int preview(const Arguments& a) {
  if (a.explain) return explain(a.preset);
  if (a.inputs.empty()) return fail(usage("no INPUT given; see trocar-mesh preview --help"));
  if (a.output.empty()) return fail(usage("no output given: -o SHEET.png or -o SHEET.html"));
  if (auto ok = check_sheet(a, a.inputs); !ok) return fail(ok.error());
  auto options = batch_options(a);
  if (!options) return fail(options.error());
  const auto open = open_options(a);
  if (!open) return fail(open.error());
  stop_on_signals();
  options->stop = &stop_requested;
  options->axis = open->axis;
  const int threads = a.jobs > 0 ? a.jobs : oneapi::tbb::info::default_concurrency();
  const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism,
                                          static_cast<std::size_t>(threads));
  const auto scan = open_scan(a, *open);
  if (!scan) return fail(scan.error());
  const std::unique_ptr<SliceStack>& stack = scan->labels;
  if (auto ok = check_sheet(a, files_read(a, *scan)); !ok) return fail(ok.error());
  if (auto ok = check_threshold(a, *stack); !ok) return fail(ok.error());
  const auto made = make_preview(*stack, *options, a.count);
  if (!made) return fail(made.error());
  const SheetText text{sheet_title(*stack, *made),
                       options_text(*options, *open, stack->pixel_unit())};
  const Sheet sheet = draw_sheet(*made, text);
  const auto png = png_of(sheet.picture);
  if (!png) return fail(png.error());
  const auto ok =
      ending_of(a.output) == ".png"
          ? write_file_atomically(a.output, *png)
          : write_file_atomically(a.output, page_of(*made, sheet, text, input_kind(*stack), *png));
  if (!ok) return fail(ok.error());
  if (a.quiet) return 0;
  for (const Warning& w : made->warnings)
    std::cerr << "trocar-mesh: warning (" << w.code << "): " << w.where << ": " << w.sentence
              << '\n';
  std::printf("%s: %zu of %d slices, %d x %d pixels\n", a.output.c_str(), made->shown.size(),
              made->slices, sheet.picture.width, sheet.picture.height);
  return 0;
}

int list(const fs::path& folder, bool as_json, bool as_collection) {
  std::vector<Warning> warnings;
  const auto scans = list_scans(folder, warnings);
  if (!scans) return fail(scans.error());
  if (as_collection) {
    std::cout << collection_of(*scans, folder, warnings);
  } else {
    std::cout << (as_json ? json_text(*scans, 1) + "\n" : scan_table(*scans, folder.string()));
  }
  for (const Warning& w : warnings)
    std::cerr << "trocar-mesh: warning (" << w.code << "): " << w.where << ": " << w.sentence
              << '\n';
  if (auto ok = check_any_usable(*scans, folder.string()); !ok) return fail(ok.error());
  return 0;
}

struct Checks {
  bool independent = false, private_too = false;
};

Result<std::size_t> verify(const fs::path& file, const Checks& checks) {
  const auto bytes = read_file(file, std::numeric_limits<std::uint32_t>::max());
  if (!bytes) return bytes.error();
  const auto asset = decode_asset(*bytes, file.string());
  if (!asset) return asset.error();
  if (auto ok = verify_asset(*asset, file.string()); !ok) return ok.error();
  if (checks.private_too) {
    if (auto ok = check_private_asset(*bytes, file.string()); !ok) return ok.error();
  }
  if (checks.independent) {
    if (auto ok = confirm_by_cgal(*asset, file.string()); !ok) return ok.error();
  }
  return slice_count(*asset);
}

// Every file is looked at; the exit code is the first error's.
int verify_all(const std::vector<fs::path>& files, const Checks& checks, bool as_json) {
  int code = 0;
  json out = json::array();
  for (const fs::path& file : files) {
    const auto slices = verify(file, checks);
    out.push_back({{"file", file.string()}, {"valid", static_cast<bool>(slices)}});
    if (checks.independent) out.back()["independent"] = true;
    if (checks.private_too) out.back()["private"] = static_cast<bool>(slices);
    if (!slices) {
      out.back()["reason"] = slices.error().message;
      const int failed = fail(slices.error());
      if (code == 0) code = failed;
    } else if (!as_json) {
      std::printf("%s: valid, %zu slices%s%s\n", file.c_str(), *slices,
                  checks.private_too ? ", private" : "",
                  checks.independent ? ", confirmed by CGAL" : "");
    }
  }
  if (as_json) std::cout << json_text(out.size() == 1 ? out[0] : out, 1) << '\n';
  return code;
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
  const bool several = out["materials"].size() > 1;
  std::printf(
      "%s\n  written by %s\n  lattice step 2^-%d mm, %zu triangles, %zu bytes\n  parameters %s\n"
      "  u (along a row) and v (along a column) count from the centre of the first pixel\n\n "
      " slice%s      z mm    rings  vertices  triangles   area mm2  box u mm, v mm                 "
      "     centroid u, v mm  mean HU\n",
      file.c_str(), asset->generator.c_str(), asset->lattice.bits,
      out["triangles"].get<std::size_t>(), out["bytes"].get<std::size_t>(),
      json_text(out["parameters"]).c_str(), several ? " material" : "");
  for (const json& s : out["slices"]) {
    std::printf("  %5d", s["index"].get<int>());
    if (several) std::printf(" %8d", s["material"].get<int>());
    std::printf(" %9.3f %8zu %9zu %10zu %10.2f", s["z_mm"].get<double>(),
                s["rings"].get<std::size_t>(), s["vertices"].get<std::size_t>(),
                s["triangles"].get<std::size_t>(), s["area_mm2"].get<double>());
    if (s["centroid_mm"].is_null()) {
      std::printf("  no material\n");
      continue;
    }
    const auto box = s["box_mm"].get<std::array<std::array<double, 2>, 2>>();
    const auto middle = s["centroid_mm"].get<std::array<double, 2>>();
    std::printf("  %7.1f to %6.1f, %6.1f to %6.1f  %7.1f, %7.1f", box[0][0], box[1][0], box[0][1],
                box[1][1], middle[0], middle[1]);
    if (s["mean_hu"].is_null()) {
      std::printf("        -\n");
    } else {
      std::printf(" %8.0f\n", s["mean_hu"].get<double>());
    }
  }
  if (several) {
    std::printf("\n  material   area mm2\n");
    for (std::size_t m = 0; m < out["materials"].size(); ++m) {
      const json& material = out["materials"][m];
      std::printf("  %8zu %10.2f  %s\n", m, material["area_mm2"].get<double>(),
                  json_text(material["name"]).c_str());
    }
  }
  for (const json& s : out["surfaces"]) {
    std::printf("  surface of material %d: %zu triangles, 99 %% of it within %.3f mm\n",
                s["material"].get<int>(), s["triangles"].get<std::size_t>(),
                s["distance_p99_mm"].get<double>());
  }
  return 0;
}

int export_to(const fs::path& file, const fs::path& folder, bool surface) {
  const auto asset = read_asset(file);
  if (!asset) return fail(asset.error());
  // Only a valid asset is exported: other programs may not detect what is wrong.
  if (const auto proved = verify_asset(*asset, file.string()); !proved) return fail(proved.error());
  stop_on_signals();
  if (surface) {
    const auto done = export_surfaces(*asset, folder, &stop_requested);
    if (done) return 0;
    const bool is_file = done.error().code == ExitCode::kRefused;
    return fail({done.error().code, (is_file ? file.string() + ": " : "") + done.error().message});
  }
  const auto others = export_asset(*asset, folder, &stop_requested);
  if (!others) return fail(others.error());
  if (!others->empty()) {
    std::fprintf(stderr, "trocar-mesh: warning: %s: still holds %s%s of another export\n",
                 folder.string().c_str(), others->front().c_str(),
                 others->size() == 1
                     ? ""
                     : (" and " + std::to_string(others->size() - 1) + " more files").c_str());
  }
  return 0;
}

// Options before a subcommand are those of meshing, and would be ignored.
Result<void> check_nothing_before(const CLI::App& app) {
  for (const CLI::Option* option : app.get_options()) {
    if (option->count() > 0) {
      return usage(option->get_name() + " cannot be combined with " +
                   app.get_subcommands().front()->get_name() + "; its own options follow it");
    }
  }
  return {};
}

int run(int argc, char** argv) {
  CLI::App app{
      "Makes an asset of exact triangle meshes, one per slice, from a CT scan.\n"
      "INPUT is a study's folder of DICOM files, a .nii/.nii.gz, or a folder or list of images."};
  app.name(kName);
  app.get_formatter()->column_width(46);
  add_help_and_version(app, kVersion);
  app.require_subcommand(0, 1);
  Arguments a;
  add_mesh_options(app, a);

  fs::path asset, folder, study;
  bool as_json = false;
  CLI::App* list_command = app.add_subcommand("list", "show the scans in a folder");
  list_command->add_option("FOLDER", study, "of a study, with its sub-folders")->required();
  CLI::App* preview_command =
      app.add_subcommand("preview", "show what a run with the same options would mesh");
  preview_command->get_formatter()->column_width(46);
  Arguments previewed;
  add_preview_options(*preview_command, previewed);
  CLI::App* verify_command = app.add_subcommand("verify", "check an asset's invariants");
  CLI::App* info_command = app.add_subcommand("info", "show what is in an asset");
  CLI::App* export_command =
      app.add_subcommand("export", "write each slice as .poly, .obj and .svg, or the surface");
  std::vector<fs::path> assets;
  Checks checks;
  verify_command->add_option("ASSET", assets, "the .glb, or several")->required();
  verify_command->add_flag("--private", checks.private_too,
                           "also refuse what could tell whose scan it was");
  verify_command->add_flag("--independent", checks.independent,
                           "also compare with CGAL's triangulation, which is not Trocar's code");
  for (CLI::App* command : {info_command, export_command})
    command->add_option("ASSET", asset, "the .glb")->required();
  for (CLI::App* command : {list_command, verify_command, info_command})
    command->add_flag("--json", as_json, "as JSON");
  export_command->add_option("-o,--output", folder, "the folder to write to")->required();
  bool as_collection = false;
  list_command
      ->add_flag("--manifest", as_collection,
                 "as a first collection for batch, with paths from the working directory")
      ->excludes("--json");
  BatchArguments batched;
  CLI::App* batch_command = app.add_subcommand(
      "batch", "make the assets of a collection of scans that are missing or stale");
  batch_command->get_formatter()->column_width(46);
  add_batch_options(*batch_command, batched);
  ReviewArguments reviewed;
  CLI::App* review_command =
      app.add_subcommand("review", "show all assets of a store, and what changed against another");
  add_review_options(*review_command, reviewed);
  bool surface = false;
  export_command->add_flag("--surface", surface, "the surface as .stl, .ply and .obj instead");

  const std::vector<std::string> words = with_preset_options(
      with_repeated("--seed", is_place, with_repeated("--labels", is_labels, {argv, argv + argc})));
  std::vector<const char*> pointers;
  pointers.reserve(words.size());
  for (const std::string& word : words)
    pointers.push_back(word.c_str());
  if (const auto done = parse_command_line(app, static_cast<int>(pointers.size()), pointers.data()))
    return *done;
  if (app.get_subcommands().empty()) {
    if (const auto ok = check_command(app, a); !ok) return fail(ok.error());
    return mesh(a);
  }
  if (const auto ok = check_nothing_before(app); !ok) return fail(ok.error());
  if (*preview_command) return preview(previewed);
  if (*list_command) return list(study, as_json, as_collection);
  if (*batch_command) return run_batch(batched);
  if (*review_command) return run_review(reviewed);
  if (*verify_command) return verify_all(assets, checks, as_json);
  if (*info_command) return info(asset, as_json);
  return export_to(asset, folder, surface);
}

// Too little memory is a property of the input, not a bug.
int run_within_memory(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const std::bad_alloc&) {
    return fail(refused("not enough memory for this input"));
  }
}

}  // namespace

int main(int argc, char** argv) {
  trocar::pipeline::keep_freed_memory();
  trocar::pipeline::leave_out_dicom_dictionary();
  return trocar::run_program(kName, [&] { return run_within_memory(argc, argv); });
}
