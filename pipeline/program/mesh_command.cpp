// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/commands.h"

#include <unistd.h>
#include <algorithm>
#include <cctype>
#include <chrono>
#include <cstdio>
#include <set>

#include "formats/asset/deidentification.h"
#include "formats/base/command_line.h"
#include "formats/base/files.h"
#include "formats/base/json.h"
#include "formats/base/text.h"
#include "pipeline/bake/mesh_stack.h"
#include "pipeline/bake/report.h"
#include "pipeline/read/file_names.h"

namespace trocar::pipeline {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

// The kernel for the report, or an empty text if it could identify the patient: DICOM allows any
// text of 16 characters, and a scanner's kernels, such as "Br40d\\3", have no ^ and no four digits
// in a row.
std::string shared_kernel(const std::string& kernel) {
  constexpr std::size_t kMaxCharacters = 16;
  const bool is_plain = kernel.size() <= kMaxCharacters && matches(kernel, "[A-Za-z0-9_ .+/-]*") &&
                        !matches(kernel, ".*[0-9]{4}.*");
  return is_plain ? kernel : "";
}

// Refuses to overwrite an input or any file that may be a scan. For example, with `-o *.png` the
// shell inserts the name of a slice as the output.
Result<void> check_outputs(const Arguments& a, const std::vector<fs::path>& read) {
  const OutputFile outputs[] = {
      {"-o", a.output}, {"--report", a.report}, {"--dump-stages", a.dump_stages}};
  for (const OutputFile& output : outputs) {
    if (!output.file.empty() && is_scan_file(output.file))
      return usage(output.option + " " + output.file.string() + ": would write over a scan");
  }
  if (auto ok = trocar::check_outputs(outputs, read); !ok) return ok;
  const std::string ending = ending_of(a.output);
  if (ending != ".glb" && !is_surface_ending(ending)) {
    return usage("-o " + a.output.string() +
                 ": an asset is a .glb, its surface alone a .stl, .ply or .obj; trocar-mesh export "
                 "writes the slices of an asset as .poly, .obj, .svg");
  }
  const StackOptions& stack = a.stack;
  if (ending != ".glb" && (stack.lines || stack.colours || stack.context_mm)) {
    return usage("-o " + a.output.string() + ": a surface has no place for " +
                 (stack.lines     ? "--lines"
                  : stack.colours ? "--colour"
                                  : "--context") +
                 "; an asset (.glb) has");
  }
  return {};
}

// A progress bar with the remaining time.
std::function<void(int, int)> slice_progress() {
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

// The name of an input in a report. The name of a folder is left out, because it is often the
// patient's name.
std::string shared_name(const fs::path& input) {
  std::error_code ignored;
  return fs::is_directory(input, ignored) ? "input" : without_folder(input);
}

// Replaces `whole` by `name` wherever it is the beginning of a path in the text.
std::string with_name(std::string text, const std::string& whole, const std::string& name) {
  constexpr std::string_view kBefore = " \"'(,";
  for (std::size_t at = 0; (at = text.find(whole, at)) != std::string::npos;) {
    const bool is_path = at == 0 || kBefore.find(text[at - 1]) != std::string_view::npos;
    if (is_path) text.replace(at, whole.size(), name);
    at += is_path ? name.size() : whole.size();
  }
  return text;
}

// Removes absolute paths, and texts that may identify the patient, from the report and its
// warnings.
json deidentified(json report, const std::vector<fs::path>& inputs) {
  const auto shorten = [&inputs](json& text) {
    std::string out = text.get<std::string>();
    for (const fs::path& input : inputs) {
      const std::string whole = (input.has_filename() ? input : input.parent_path()).string();
      const std::string name = shared_name(input);
      std::error_code ignored;
      if (fs::is_directory(input, ignored))
        out = with_name(std::move(out), std::string(whole).append("/"),
                        std::string(name).append("/"));
      if (input.is_absolute() && !name.empty()) out = with_name(std::move(out), whole, name);
      // A DICOMDIR stands for the files of its folder.
      if (input.has_parent_path() && !fs::is_directory(input, ignored))
        out = with_name(std::move(out), input.parent_path().string().append("/"), "input/");
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

// Adds the input files and the output, which has been written, to the report.
Result<void> describe_files(const Arguments& a, const SliceStack& stack, StackResult& result) {
  const auto digest = digest_file(a.output);
  if (!digest) return digest.error();
  const bool is_asset = ending_of(a.output) == ".glb";
  json& written =
      is_asset ? result.report["asset"] : result.report["surface"][result.surfaces[0].material];
  written["digest"] = *digest;
  written["file"] = without_folder(a.output);
  json inputs = json::array();
  for (const fs::path& input : a.inputs)
    inputs.push_back(shared_name(input));
  result.report["input"] = {{"paths", std::move(inputs)},
                            {"slices", stack.size()},
                            {"width_px", stack.width()},
                            {"height_px", stack.height()}};
  if (!a.hu.empty()) result.report["input"]["hu"] = shared_name(a.hu);
  if (!result.input_key_digest.empty())
    result.report["input"]["key_digest"] = result.input_key_digest;
  if (stack.series) result.report["input"]["series"] = series_for_report(*stack.series);
  return {};
}

// Reads the asset as every reader will, before it gets its name.
Result<void> check_asset(const Arguments& a, const StackResult& result) {
  const std::string name = a.output.string() + " is not written: as an asset it would be refused";
  const auto asset = decode_asset(result.glb, name);
  return asset ? verify_asset(*asset, name) : asset.error();
}

// The surface as a file of its own.
Result<void> write_surface(const Arguments& a, const StackResult& result) {
  if (result.surfaces.size() != 1)
    return usage("-o " + a.output.string() + ": the scan has " +
                 std::to_string(result.surfaces.size()) +
                 " surfaces, one for each material; write an asset with --surface, then use "
                 "trocar-mesh export --surface");
  const auto text = surface_text(result.surfaces[0].surface, ending_of(a.output));
  if (!text) return text.error();
  return write_file_atomically(a.output, *text);
}

Result<void> write_outputs(const Arguments& a, const SliceStack& stack, StackResult& result) {
  const auto written = ending_of(a.output) == ".glb" ? write_file_atomically(a.output, result.glb)
                                                     : write_surface(a, result);
  if (!written) return written.error();
  const auto after_it = [&a](const Error& error) -> Error {
    return {error.code, error.message + "; " + a.output.string() + " is written",
            error.is_temporary};
  };
  if (auto ok = describe_files(a, stack, result); !ok) return after_it(ok.error());
  if (!a.report.empty()) {
    std::vector<fs::path> given = a.inputs;
    if (!a.hu.empty()) given.push_back(a.hu);
    const json report = deidentified(result.report, given);
    if (auto ok = write_file_atomically(a.report, json_text(report, 1) + "\n"); !ok)
      return after_it(ok.error());
  }
  if (a.dump_stages.empty()) return {};
  const auto ok = write_file_atomically(a.dump_stages, json_text(result.stages) + "\n");
  return ok ? ok : after_it(ok.error());
}

void print_outcome(const Arguments& a, const StackResult& result) {
  const json& report = result.report;
  for (const json& w : report["warnings"])
    print_warning({w["code"], w["where"], w["sentence"]});
  if (ending_of(a.output) != ".glb") {
    print(stdout, "%s: a surface of %zu triangles, %.0f ms\n", a.output,
          result.surfaces[0].surface.triangles.size(), report["total_ms"].get<double>());
    return;
  }
  std::set<int> slices;  // a set, because each of several materials has an entry
  for (const json& slice : report["slices"])
    slices.insert(slice["index"].get<int>());
  print(stdout, "%s: %zu slices, %zu triangles, %zu bytes, %.0f ms\n", a.output, slices.size(),
        report["asset"]["triangles"].get<std::size_t>(),
        report["asset"]["bytes"].get<std::size_t>(), report["total_ms"].get<double>());
}

}  // namespace

Result<LabelsWithCt> open_scan(const Arguments& a) {
  if (!a.hu.empty()) return open_labels_with_ct(a.inputs, a.hu, a.open);
  auto stack = open_stack(a.inputs, a.open);
  if (!stack) return stack.error();
  return LabelsWithCt{std::move(*stack), nullptr};
}

std::vector<std::filesystem::path> files_read(const Arguments& a, const LabelsWithCt& scan) {
  std::vector<std::filesystem::path> out = scan.labels->files;
  if (scan.ct != nullptr) out.insert(out.end(), scan.ct->files.begin(), scan.ct->files.end());
  if (!a.names.empty()) out.emplace_back(a.names);
  if (!a.input_key.empty()) out.push_back(a.input_key);
  if (!a.stack.solid.mask_file.empty()) out.emplace_back(a.stack.solid.mask_file);
  return out;
}

Result<void> check_input(const Arguments& a, SliceStack& stack) {
  if (a.open.completeness_unknown) {
    stack.warnings.push_back({"completeness_unknown", "--completeness-unknown",
                              "nobody has said how many images the scan has; some may be missing"});
  }
  if (stack.pixel_unit() == PixelUnit::kHounsfield || a.labels || a.equalize) return {};
  if (stack.pixel_unit() == PixelUnit::kUncalibrated) {
    if (!a.threshold || !a.preset.empty()) {
      const auto sentence = [](const std::string& modality) {
        return "its default and the presets are meant in HU; values of " + modality +
               " need one of their own";
      };
      stack.warnings.push_back({"default_threshold", "--threshold", sentence(stack.modality),
                                sentence(shared_modality(stack.modality))});
    }
    return {};
  }
  if (!a.preset.empty()) {
    return usage("--preset " + a.preset +
                 " is for HU, which images do not carry: give --equalize "
                 "LEVEL, or --threshold with a grey level of 0..255");
  }
  if (!a.threshold) {
    return usage(
        "images carry no HU: give --equalize LEVEL, or --threshold with a grey level of 0..255");
  }
  if (!(*a.threshold >= 0 && *a.threshold <= 255)) {
    stack.warnings.push_back({"threshold_out_of_range", "--threshold",
                              "images have grey levels of 0..255, whatever their depth; with this "
                              "threshold all of a slice is material, or nothing"});
  }
  return {};
}

Result<StackResult> mesh_scan(Arguments& a, const LabelsWithCt& scan) {
  const SliceStack& stack = *scan.labels;
  a.stack.mesh.hu = scan.ct.get();
  a.stack.stop = &stop_requested;
  // A volume that is not DICOM is axial even without --axis.
  if (!stack.series && a.open.axis == SliceAxis::kAxial) a.open.axis.reset();
  a.stack.axis = a.open.axis;
  follow_small_pixels(stack, a.stack);
  return mesh_stack(stack, a.stack, parameters_json(a.stack, a.open));
}

json series_for_report(const SeriesInfo& series) {
  return {{"number", series.number ? json(*series.number) : json()},
          {"kernel", shared_kernel(series.kernel)},
          {"modality", is_modality(series.modality) ? series.modality : ""}};
}

int run_mesh(Arguments a) {
  a.surface = a.surface || is_surface_ending(ending_of(a.output));
  if (a.inputs.empty()) return fail(usage("no INPUT given; see trocar-mesh --help"));
  if (a.output.empty()) return fail(usage("no output given: -o OUT.glb"));
  if (auto ok = check_outputs(a, a.inputs); !ok) return fail(ok.error());
  if (auto ok = complete(a); !ok) return fail(ok.error());
  a.open.unpack_behind = true;
  stop_on_signals();
  const auto scan = open_scan(a);
  if (!scan) return fail(scan.error());
  const std::unique_ptr<SliceStack>& stack = scan->labels;
  if (auto ok = check_outputs(a, files_read(a, *scan)); !ok) return fail(ok.error());
  if (auto ok = check_input(a, *stack); !ok) return fail(ok.error());
  if (!a.quiet && ::isatty(STDERR_FILENO) != 0) a.stack.progress = slice_progress();
  auto result = mesh_scan(a, *scan);
  if (!result) return fail(result.error());
  if (!a.dump_stages.empty() && result->stages.is_null())
    return fail(usage("--dump-stages needs --dump-slice with a slice that was meshed"));
  if (auto ok = check_asset(a, *result); !ok) return fail(ok.error());
  if (auto ok = write_outputs(a, *stack, *result); !ok) return fail(ok.error());
  if (!a.quiet) print_outcome(a, *result);
  return 0;
}

std::string ending_of(const std::filesystem::path& file) {
  std::string ending = file.extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return ending;
}

int fail(const Error& error) {
  return report_error(kProgram, error);
}

void print_warning(const Warning& warning) {
  print(stderr, "%s: warning (%s): %s: %s\n", kProgram, warning.code, warning.where,
        warning.sentence);
}

}  // namespace trocar::pipeline
