// SPDX-License-Identifier: GPL-3.0-or-later
// The options of trocar-mesh for meshing or previewing a scan: their names, defaults and ranges.
#pragma once

#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "formats/base/command_line.h"

namespace trocar::pipeline {

/// The values of the options. For some options X, X_option.is_given() returns whether the command
/// line or a preset gives X. If the command has no option X, the result is false.
struct Arguments {
  std::vector<std::filesystem::path> inputs;
  std::filesystem::path output, report, dump_stages, hu, input_key;
  double threshold = 226, equalize = 230, tolerance_mm = 0.2, min_angle_deg = 30, max_area_mm2 = 50,
         max_area_px2 = 200, min_region_mm2 = 1, close_mm = 0, min_volume_mm3 = 0, grade_hu = 0;
  std::vector<std::string> labels, seeds;
  std::string fill, mask, names, context, keep = "all";
  std::string contour = "subpixel", simplify = "area", axis = "transverse", preset, series, spacing,
              slices, crop;
  int lattice_bits = 8, jobs = 0, dump_slice = -1, volume = 0, largest = 0, count = 12,
      surface_triangles = 50'000;
  bool any_modality = false, quiet = false, explain = false, no_hu = false, lines = false,
       colour = false, surface = false, keep_table = false;
  Option threshold_option, equalize_option, labels_option, area_option, area_px_option, axis_option,
      dump_slice_option, volume_option, context_option, surface_triangles_option, tolerance_option,
      min_region_option, lattice_option;
  /// The options whose values come from --preset (added_by_preset()).
  std::set<std::string> of_preset;
};

/// Declares the options of meshing. Parsing writes their values to `a`.
void add_mesh_options(const Command& command, Arguments& a);
/// Declares the options of a preview: --count, and the options of meshing except those for outputs
/// that a preview does not write. Parsing writes their values to `a`.
void add_preview_options(const Command& command, Arguments& a);

}  // namespace trocar::pipeline
