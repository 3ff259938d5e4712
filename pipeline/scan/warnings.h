// SPDX-License-Identifier: GPL-3.0-or-later
// Collects the warnings about slices and about the whole scan, and makes the report's entries.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "pipeline/scan/label_names.h"
#include "pipeline/scan/mesh_slice.h"

namespace trocar::pipeline {

/// A warning about one slice. In the report, `value` replaces the first # of the sentence.
struct SliceWarning {
  std::string code;
  int slice = 0;
  std::string sentence;
  double value = 0;
};

/// The warnings about the mesh of the slice with this index.
std::vector<SliceWarning> slice_warnings(int index, const MeshedSlice& meshed,
                                         const Segmentation& segmentation, const LabelNames& names);

/// What was changed in the slice with this index, and the area of its material afterwards.
struct ChangedSlice {
  int slice = 0;
  double area_mm2 = 0;
  SliceChanges changes;
};

/// Warns of what was changed without being asked for: regions_dropped, holes_filled (both below
/// MaterialOptions::min_region_mm2) and outline_moved, each if it is more than 1 % of the
/// material's area, with the slices in which it is.
std::vector<SliceWarning> change_warnings(const std::vector<ChangedSlice>& slices,
                                          double min_region_mm2, double tolerance_mm);

/// Makes `warnings[]` of the report, with one entry for each code, in the order in which the codes
/// first occur. An entry has `code`, `where` and `sentence`. It also has `slices` (numbers) if the
/// warnings concern slices, and `places` (the texts of Warning::where) if they concern the scan. If
/// Warning::shared is not empty, the entry has it as `shared`. If SliceWarning::value differs
/// between slices, the sentence states the lowest and the highest value.
nlohmann::json warnings_json(const std::vector<Warning>& of_scan,
                             const std::vector<SliceWarning>& of_slices);

/// Merges the warnings of each code into one, as warnings_json() does.
std::vector<Warning> grouped(const std::vector<Warning>& warnings);

/// Makes the first entries of `warnings[]` for a run. They are the warnings of the stack and of the
/// slices and, if they apply: voxel_volume (the input states two voxel sizes, read/voxel_volume.h),
/// face (the threshold is so low that a face can be recognised in the asset), and the result of
/// value_warning() in label_map_detection.h. mesh_stack() appends the warnings of other steps.
/// `values` and `area_mm2` are totals over all meshed slices.
nlohmann::json run_warnings(const SliceStack& stack, const Segmentation& segmentation,
                            const ValueTally& values, double area_mm2,
                            const std::vector<SliceWarning>& of_slices);

}  // namespace trocar::pipeline
