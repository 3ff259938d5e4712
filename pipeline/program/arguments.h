// SPDX-License-Identifier: GPL-3.0-or-later
// The options of trocar-mesh for meshing or previewing a scan. Parsing fills StackOptions and
// OpenOptions.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "pipeline/read/slice_stack.h"
#include "pipeline/scan/mesh_stack.h"

namespace CLI {  // NOLINT(readability-identifier-naming): CLI11's
class App;
}  // namespace CLI

namespace trocar::pipeline {

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

/// The name of the axis: "transverse" (for kAxial), "coronal" or "sagittal".
const char* axis_name(SliceAxis axis);

/// The options of meshing and opening as the parameters that reports and assets store.
nlohmann::json parameters_json(const StackOptions& options, const OpenOptions& input);

}  // namespace trocar::pipeline
