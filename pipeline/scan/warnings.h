// SPDX-License-Identifier: GPL-3.0-or-later
// The warnings of a run: those of slices and of the whole scan, and their entries in the report.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "pipeline/scan/label_names.h"
#include "pipeline/scan/mesh_slice.h"

namespace trocar::pipeline {

/// A warning of one slice. `value` replaces a # in the sentence.
struct SliceWarning {
  std::string code;
  int slice = 0;
  std::string sentence;
  double value = 0;
};

/// The warnings about the mesh of the slice with this index.
std::vector<SliceWarning> slice_warnings(int index, const MeshedSlice& meshed,
                                         const Segmentation& segmentation, const LabelNames& names);

/// Makes `warnings[]` of the report. It has one entry for each code, in the order in which the
/// codes first occur. An entry has `code`, `where`, `sentence`, and all `slices` (numbers) or
/// `places` (the texts of Warning::where). If the values of the slices differ, the sentence states
/// the lowest and the highest.
nlohmann::json warnings_json(const std::vector<Warning>& of_scan,
                             const std::vector<SliceWarning>& of_slices);

/// One warning for each code, as in warnings_json().
std::vector<Warning> grouped(const std::vector<Warning>& warnings);

/// `warnings[]` of a run: the warnings of the stack and of the slices, voxel_volume
/// (read/voxel_volume.h), face (a face can be recognised in the asset), and those of
/// label_map_detection.h. `values` and `area_mm2` are totals over all meshed slices.
nlohmann::json run_warnings(const SliceStack& stack, const Segmentation& segmentation,
                            const ValueTally& values, double area_mm2,
                            const std::vector<SliceWarning>& of_slices);

}  // namespace trocar::pipeline
