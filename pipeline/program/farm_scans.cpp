// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/farm_scans.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <system_error>
#include <utility>
#include <variant>

#include "formats/base/command_line.h"
#include "formats/base/json_text.h"
#include "formats/base/nearest_name.h"
#include "formats/base/program.h"
#include "pipeline/open/scan_folder.h"
#include "pipeline/program/arguments.h"
#include "pipeline/program/mesh_scan.h"
#include "pipeline/program/messages.h"
#include "pipeline/program/presets.h"
#include "pipeline/program/stage_options.h"
#include "pipeline/read/file_names.h"
#include "pipeline/read/nrrd/nrrd_stack.h"
#include "pipeline/scan/small_pixels.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// Options that a collection cannot give as parameters: the store determines the outputs, the batch
// the number of threads, and `input` in the collection the series.
const std::set<std::string>& excluded_options() {
  static const std::set<std::string> names = {"output", "report", "dump-stages", "dump-slice",
                                              "series", "jobs",   "quiet",       "explain"};
  return names;
}

// The options and their values. The options refer to the values, so this object cannot be moved.
struct Parsed {
  CommandLine line{kProgram, "", ""};
  Arguments a;
  StackOptions options;
  OpenOptions open;
  Parsed() { add_mesh_options(line, a); }
};

/// An option of meshing that a collection can give as a parameter.
struct Parameter {
  std::string name;
  bool is_flag;
};

std::vector<Parameter> parameters_of(const CommandLine& line) {
  std::vector<Parameter> out;
  for (const Option& option : line.options()) {
    for (const std::string& name : option.long_names())
      if (!excluded_options().contains(name)) out.push_back({name, option.is_flag()});
  }
  return out;
}

std::vector<std::string> names_of(const std::vector<Parameter>& parameters) {
  std::vector<std::string> out;
  out.reserve(parameters.size());
  for (const Parameter& each : parameters)
    out.push_back(each.name);
  return out;
}

Result<void> add_words(const std::vector<Parameter>& known, const std::string& name,
                       const json& value, std::vector<std::string>& words) {
  const std::string given = "parameter " + name + ": ";
  const auto found = std::find_if(known.begin(), known.end(),
                                  [&](const Parameter& each) { return each.name == name; });
  if (found == known.end()) {
    if (excluded_options().contains(name))
      return usage(given + "is not for the scans of a collection");
    return usage(given + "no such option" + did_you_mean(name, names_of(known)));
  }
  if (value.is_boolean() != found->is_flag)
    return usage(given + (found->is_flag ? "must be true or false" : "must be a number or a text"));
  if (found->is_flag) {
    words.push_back("--" + name);
    return {};
  }
  for (const json& one : value.is_array() ? value : json::array({value}))
    words.push_back("--" + name + "=" +
                    (one.is_string() ? one.get<std::string>() : json_text(one)));
  return {};
}

Result<std::unique_ptr<Parsed>> parse(const json& given) {
  auto out = std::make_unique<Parsed>();
  std::vector<std::string> words = {kProgram};
  const std::vector<Parameter> known = parameters_of(out->line);
  for (const auto& [name, value] : given.items()) {
    if (auto ok = add_words(known, name, value, words); !ok) return ok.error();
  }
  if (auto ok = out->line.parse(with_preset_options(words)); !ok)
    return usage("parameters: " + ok.error().message);
  out->a.of_preset = added_by_preset(words);
  auto options = stack_options(out->a);
  if (!options) return options.error();
  auto open = open_options(out->a);
  if (!open) return open.error();
  out->options = std::move(*options);
  out->open = std::move(*open);
  return out;
}

std::vector<farm::NamedFile> files_of(const Parsed& parsed) {
  const Arguments& a = parsed.a;
  const std::string& mask_file = parsed.options.solid.mask_file;
  std::vector<farm::NamedFile> out;
  if (!a.hu.empty()) out.push_back({"hu", a.hu});
  if (!a.input_key.empty()) out.push_back({"input-key", a.input_key});
  if (!mask_file.empty()) out.push_back({"mask", mask_file});
  if (!a.names.empty() && !LabelNames::is_table(a.names)) out.push_back({"names", a.names});
  return out;
}

json segmentation_json(const Segmentation& how) {
  if (const auto* threshold = std::get_if<Threshold>(&how))
    return {{"threshold", threshold->value}};
  if (const auto* equalize = std::get_if<Equalize>(&how)) return {{"equalize", equalize->level}};
  const auto& labels = std::get<Labels>(how);
  json out = {{"labels", labels.all ? json("all") : json(labels.labels)}};
  if (!labels.joined.empty()) out["labels-joined"] = labels.joined;
  return out;
}

json seeds_json(const std::vector<Eigen::Vector3d>& seeds) {
  json out = json::array();
  for (const Eigen::Vector3d& seed : seeds)
    out.push_back({seed.x(), seed.y(), seed.z()});
  return out;
}

// The value of an option. A default that follows small pixels is another value than the same number
// that was given.
template <typename Number>
json value_of(Number value, bool follows_pixels) {
  return follows_pixels ? json{{"default", value}} : json(value);
}

// Every option that can change a byte of the outputs, under its name. Defaults are included, so
// that giving a default explicitly does not change the key, unless the default follows the pixels.
json canonical(const Parsed& parsed) {
  const auto& [line, a, o, open] = parsed;
  json out = segmentation_json(o.mesh.segmentation);
  out.update({{"contour", a.contour},
              {"simplify", a.simplify},
              {"tolerance", value_of(a.tolerance_mm, o.defaults.tolerance)},
              {"min-angle", a.min_angle_deg},
              {"grade", a.grade_hu},
              {"min-region", value_of(a.min_region_mm2, o.defaults.min_region)},
              {"close", value_of(a.close_mm, o.defaults.close)},
              {"min-volume", value_of(a.min_volume_mm3, o.defaults.min_volume)},
              {"keep", a.keep},
              {"keep-table", a.keep_table},
              {"largest", a.largest},
              {"seed", seeds_json(o.solid.seeds_lps_mm)},
              {"mask", o.solid.mask_labels},
              {"surface", a.surface},
              {"any-modality", a.any_modality},
              {"no-hu", a.no_hu},
              {"lattice-bits", value_of(a.lattice_bits, o.defaults.lattice_bits)},
              {"lines", a.lines},
              {"colour", a.colour}});
  if (o.mesh.max_area_px2) {
    out["max-area-px"] = *o.mesh.max_area_px2;
  } else {
    out["max-area"] = a.max_area_mm2;
  }
  out["fill"] = o.solid.fill_mm2
                    ? (std::isfinite(*o.solid.fill_mm2) ? json(*o.solid.fill_mm2) : json("all"))
                    : json();
  if (o.context_mm) out["context"] = *o.context_mm;
  if (open.volume) out["volume"] = *open.volume;
  // The default number of triangles of the surface may be exceeded, but a given number may not.
  out["surface-triangles"] = o.surface && o.surface->at_most ? json(o.surface->triangles) : json();
  out["names"] = LabelNames::is_table(a.names) ? json(a.names) : json();
  out["spacing"] = open.spacing_mm ? json(*open.spacing_mm) : json();
  out["slices"] = o.slices ? json({o.slices->first, o.slices->second}) : json();
  out["crop"] = o.mesh.crop
                    ? json({o.mesh.crop->x0, o.mesh.crop->x1, o.mesh.crop->y0, o.mesh.crop->y1})
                    : json();
  out["axis"] = open.axis ? json(axis_name(*open.axis)) : json();
  // A given threshold is not the same as the default with these two options: images, which need
  // --spacing, are refused without one, and other modalities get a warning (check_threshold()).
  if (a.any_modality || open.spacing_mm)
    out["threshold-given"] = a.threshold_option.is_given() && a.preset.empty();
  return out;
}

// The report without values that differ from run to run or depend on other files in the input's
// folder.
std::string stored_report(json report, const SliceStack& stack) {
  for (const char* key : {"total_ms", "assemble_ms", "stages_ms", "threads", "peak_rss_bytes"})
    report.erase(key);
  for (json& slice : report["slices"])
    slice.erase("ms");
  if (report.contains("surface"))
    for (json& surface : report["surface"])
      surface.erase("ms");
  const std::string name = input_name(stack);
  for (json& warning : report["warnings"]) {
    if (const auto shared = warning.find("shared"); shared != warning.end()) {
      warning["sentence"] = *shared;
      warning.erase("shared");
    }
    if (warning["where"] == name) warning["where"] = "input";
    if (const auto places = warning.find("places"); places != warning.end())
      std::replace(places->begin(), places->end(), json(name), json("input"));
  }
  report["input"] = {
      {"slices", stack.size()}, {"width_px", stack.width()}, {"height_px", stack.height()}};
  if (stack.series) report["input"]["series"] = series_for_report(*stack.series);
  return json_text(report, 1) + "\n";
}

class Opened : public farm::OpenedScan {
 public:
  // `warnings` are the warnings of opening the scan.
  Opened(std::unique_ptr<Parsed> parsed, LabelsWithCt scan, json warnings)
      : parsed_(std::move(parsed)), scan_(std::move(scan)), warnings_(std::move(warnings)) {}

  std::vector<farm::NamedFile> files() const override {
    std::vector<farm::NamedFile> out;
    for (const fs::path& file : scan_.labels->files)
      out.push_back({"input", file});
    if (scan_.ct != nullptr)
      for (const fs::path& file : scan_.ct->files)
        out.push_back({"hu", file});
    for (farm::NamedFile& file : files_of(*parsed_))
      if (file.of == "mask") {
        for (fs::path& path : files_of_volume(file.path))
          out.push_back({file.of, std::move(path)});
      } else if (file.of != "hu") {
        out.push_back(std::move(file));
      }
    return out;
  }

  json warnings() const override { return warnings_; }

  Result<farm::ScanOutputs> mesh() override {
    SliceStack& stack = *scan_.labels;
    StackOptions& options = parsed_->options;
    OpenOptions& open = parsed_->open;
    options.mesh.hu = scan_.ct.get();
    options.stop = &stop_requested;
    if (!stack.series && open.axis == SliceAxis::kAxial) open.axis.reset();
    options.axis = open.axis;
    follow_small_pixels(stack, options);
    auto result = mesh_stack(stack, options, parameters_json(options, open));
    if (!result) return result.error();
    farm::ScanOutputs out;
    out.asset = std::move(result->glb);
    out.report = stored_report(std::move(result->report), stack);
    return out;
  }

 private:
  std::unique_ptr<Parsed> parsed_;
  LabelsWithCt scan_;
  json warnings_;
};

bool is_nifti_file(const fs::path& path) {
  std::error_code ignored;
  return is_nifti(path) && fs::is_regular_file(path, ignored);
}

}  // namespace

std::vector<std::string> collection_options() {
  return names_of(parameters_of(Parsed().line));
}

Result<farm::Parameters> FarmScans::parameters(const json& given) const {
  const auto parsed = parse(given);
  if (!parsed) return parsed.error();
  return farm::Parameters{canonical(**parsed), files_of(**parsed)};
}

Result<std::unique_ptr<farm::OpenedScan>> FarmScans::open(const json& given,
                                                          const std::vector<fs::path>& inputs,
                                                          const std::string& series,
                                                          int threads) const {
  auto parsed = parse(given);
  if (!parsed) return parsed.error();
  Arguments& a = (*parsed)->a;
  a.inputs = inputs;
  (*parsed)->open.series = series;
  (*parsed)->options.threads = threads;
  auto scan = open_scan(a, (*parsed)->open);
  if (!scan) return scan.error();
  // The report of meshing omits the warnings of opening, because they can be about files that do not
  // belong to the scan.
  SliceStack& stack = *scan->labels;
  json warnings = json::array();
  for (const Warning& w : stack.warnings) {
    warnings.push_back({{"code", w.code}, {"where", w.where}, {"sentence", w.sentence}});
    if (!w.shared.empty()) warnings.back()["shared"] = w.shared;
  }
  stack.warnings.clear();
  if (auto ok = check_threshold(a, stack); !ok) return ok.error();
  return std::unique_ptr<farm::OpenedScan>(
      std::make_unique<Opened>(std::move(*parsed), std::move(*scan), std::move(warnings)));
}

bool FarmScans::opens_first(const std::vector<fs::path>& inputs,
                            const farm::Parameters& parameters) const {
  return !std::all_of(inputs.begin(), inputs.end(), is_nifti_file) ||
         std::any_of(parameters.files.begin(), parameters.files.end(),
                     [](const farm::NamedFile& file) {
                       return (file.of == "hu" || file.of == "mask") && !is_nifti_file(file.path);
                     });
}

}  // namespace trocar::pipeline
