// SPDX-License-Identifier: GPL-3.0-or-later
// Collects the warnings about slices and about the whole scan, and makes the report's entries.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "pipeline/bake/label_names.h"
#include "pipeline/bake/mesh_slice.h"
#include "pipeline/bake/mesh_stack.h"
#include "pipeline/read/slice_stack.h"

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
/// slices and, if they apply: voxel_volume (the input states two voxel sizes, read/slice_stack.h),
/// face (the threshold is so low that a face can be recognised in the asset), and the result of
/// value_warning() in segment/label_pixels.h. mesh_stack() appends the warnings of other steps.
/// `values` and `area_mm2` are totals over all meshed slices.
nlohmann::json run_warnings(const SliceStack& stack, const Segmentation& segmentation,
                            const ValueTally& values, double area_mm2,
                            const std::vector<SliceWarning>& of_slices);

// Defaults in mm that follow the pixel where it is small, as in micro-CT: they are meant for
// clinical CT, and would drop or move most of the structures of a finer scan.

/// Sets the options of DefaultOptions for a scan with small pixels; otherwise changes nothing. Of
/// different pixels the smallest counts.
///  - tolerance: at most 0.4 of the narrower side, so that no outline moves by half a pixel
///  - smallest region: at most 4 pixels
///  - lattice: at least 64 steps a pixel, as far as an asset can hold the slice and the lattice
///    goes
///  - close: at most 10 pixels for each 3 mm; smallest volume: with the third power of that
/// Both methods of the last line apply to values of a preset.
void follow_small_pixels(const SliceStack& stack, StackOptions& options);

// Makes JSON from the results of a run: entries of the report (--report), the measures of a slice
// that the asset stores, and the data of one slice for pictures (--dump-stages).

/// Makes those members of a slice's first entry that tell what was changed in it: dropped_mm2,
/// filled_mm2 and moved_mm2, with SolidBone also solid_dropped_mm2 and solid_filled_mm2.
nlohmann::json changes_report(const SliceChanges& changes);

/// Makes the entry of the report's list `slices` for one material of a slice. mesh_stack() adds the
/// members `ms` (the times by stage) and `material`.
nlohmann::json slice_report(int index, double z_mm, const MeshedMaterial& material,
                            double max_area_bound_mm2);

/// Makes those members of the entry of slice_report() that are also stored in the asset.
nlohmann::json slice_measures(const MeshedMaterial& material);

/// Lists contours, PSLG, constrained Delaunay triangulation and refined mesh of a slice, in mm.
/// Each list combines all materials.
nlohmann::json slice_stages(int index, const SlicePlane& plane, const MeshedSlice& slice,
                            const Lattice& lattice);

/// Makes the member `asset` of the report. `bytes` is the size of the asset's file. If the asset
/// has a surface, mesh_stack() adds `surface_bytes` to this member of the report.
nlohmann::json asset_report(const AssetSizes& sizes, std::size_t bytes);

/// Largest resident memory that this process has used so far.
std::uint64_t peak_rss_bytes();

}  // namespace trocar::pipeline
