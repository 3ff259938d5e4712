// SPDX-License-Identifier: GPL-3.0-or-later
// The options of trocar-mesh for meshing or previewing a scan, and their presets. A preset is a named
// list of options with values, which `--explain` prints; what the command line gives itself counts.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/bake/mesh_stack.h"
#include "pipeline/read/slice_stack.h"

namespace CLI {  // NOLINT(readability-identifier-naming): CLI11's
class App;
}  // namespace CLI

namespace trocar::pipeline {

/// Returns the words of a command line together with the options of its `--preset`. An option that
/// the command line gives itself is not added. If the command line gives `--max-area`, the preset's
/// `--max-area-px` is not added either, because both limit the area of triangles. If no preset has
/// the name that `--preset` gives, nothing is added.
std::vector<std::string> with_preset_options(const std::vector<std::string>& words);

/// The names of the options that with_preset_options() adds to the words, such as "--close".
std::set<std::string> added_by_preset(const std::vector<std::string>& words);

/// A text with the options and the purpose of the preset `name`, or of all presets if `name` is
/// empty. Errors: kUsage if there is no such preset.
Result<std::string> explain_presets(const std::string& name);

/// Parsing fills StackOptions and OpenOptions.
struct Arguments {
  std::vector<std::filesystem::path> inputs;
  std::filesystem::path output, report, dump_stages, hu, input_key;
  std::string names, preset;
  StackOptions stack;
  OpenOptions open;
  // Of these, at most one is given; complete() makes it StackOptions::mesh.segmentation.
  std::optional<double> threshold, equalize;
  std::optional<Labels> labels;
  bool surface = false;  ///< complete() makes it StackOptions::surface, with the number
  std::optional<int> surface_triangles;
  int count = 12;  ///< slices of a preview
  bool quiet = false, explain = false;
  /// The options whose values come from --preset (added_by_preset()).
  std::set<std::string> of_preset;
};

/// Declares the options of meshing.
void add_mesh_options(CLI::App& app, Arguments& a);
/// Declares the options of a preview: --count, and the options of meshing except those for outputs
/// that a preview does not write.
void add_preview_options(CLI::App& app, Arguments& a);

/// Completes the options after parsing; reads the files of --names and --input-key. Errors: kUsage
/// if an option excludes another one; the errors of reading.
Result<void> complete(Arguments& a);

/// The options of meshing and opening as the parameters that reports and assets store.
nlohmann::json parameters_json(const StackOptions& options, const OpenOptions& input);

}  // namespace trocar::pipeline
