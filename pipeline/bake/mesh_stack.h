// SPDX-License-Identifier: GPL-3.0-or-later
// Meshes the slices of a scan in parallel into one asset and one report.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "formats/asset/asset.h"
#include "pipeline/bake/label_names.h"
#include "pipeline/bake/mesh_slice.h"
#include "pipeline/read/parallel_for.h"
#include "pipeline/segment/segmentation.h"
#include "pipeline/surface/display_surface.h"

namespace trocar::pipeline {

/// Which options have their default value, or close and min_volume that of a preset
/// (report.h).
struct DefaultOptions {
  bool tolerance = false, min_region = false, lattice_bits = false, close = false,
       min_volume = false;
};

struct StackOptions {
  MeshOptions mesh;
  DefaultOptions defaults;
  SolidOptions solid;
  bool keep_table = false;  ///< false: the scanner's table is removed (scanner_table.h)
  LabelNames names;         ///< a label without a name here gets its name from the scan
  std::optional<SurfaceOptions> surface;      ///< if set, surfaces for display are added
  std::optional<SliceAxis> axis;              ///< OpenOptions::axis with which the stack was opened
  std::optional<std::pair<int, int>> slices;  ///< first and last index; no value: all
  int threads = 0;                            ///< 0: all cores
  std::vector<std::uint8_t> input_key;        ///< key for the input's digest; empty: no digest
  bool lines = false;                         ///< store the outlines as lines, for viewers
  bool colours = false;                       ///< store the HU as vertex colours, for viewers
  /// Pitch of Asset::context, mm. 0: default_context_mm(); no value: the asset gets no context.
  std::optional<double> context_mm;
  std::optional<int> dump_slice;  ///< slice whose StackResult::stages are wanted
  /// Called after each slice by the thread that meshed it; never by two threads at the same time.
  std::function<void(int done, int total)> progress;
  const std::atomic<bool>* stop = nullptr;  ///< if not null: mesh_stack() stops once it is true
  /// The report's total_ms begins at this time. Set it before opening the scan to
  /// include the opening.
  std::chrono::steady_clock::time_point start = std::chrono::steady_clock::now();
};

struct StackResult {
  std::string input_key_digest;  ///< empty if input_key is empty
  std::vector<std::uint8_t> glb;
  std::vector<AssetSurface> surfaces;  ///< the surfaces in the glb
  nlohmann::json report;
  nlohmann::json stages;  ///< contours, outline and meshes of slice dump_slice, or null
};

/// Checks the options against the stack. Errors: kUsage if slices or crop are outside the stack, if
/// the crop is less than two pixels wide or high, if vertex colours or a context are wanted but
/// there are no HU, or if areas graded by HU (GradedArea) are wanted but the scan is not in HU
/// (the CT of a label map does not suffice).
Result<void> check_ranges(const SliceStack& stack, const StackOptions& options);

/// Meshes the stack. The same stack and options give the same glb, with any number of threads.
/// `parameters` is stored in asset and report, which also state the modality if values are
/// uncalibrated (formats/asset/asset.md). report.h describes the warnings in the report. If a
/// slice fails, there is no asset. If several slices fail, the error of the one with the lowest
/// index is returned. Errors: those of check_ranges(), SolidBone::make(), encoding_grid(),
/// mesh_slice(), check_entry_count() and add_surfaces(); kRefused if no slice has any material, or
/// if there are more than kMaxMaterials; kUnwritable if StackOptions::stop has interrupted the run.
Result<StackResult> mesh_stack(const SliceStack& stack, const StackOptions& options,
                               const nlohmann::json& parameters);

// The error for a scan without any triangles.

/// Returns the error (kRefused) for a scan in which no slice from `first` to `last`, both included,
/// has triangles. The function does not check this. The message gives the reason, the values in the
/// slices, and options to try. If the values look like a label map, the message also lists the
/// labels. The function reads the slices again; if reading fails, it returns the error of reading.
Error empty_asset_error(const SliceStack& stack, int first, int last, const MeshOptions& options,
                        const LabelNames& names = {});

// The names and labels of the materials of an asset that is made from a label map.

/// Returns the name of the material with this first label. A material of one label has that label's
/// name. A material of several labels (Labels::joined) has their names, with " + " between them. If
/// not all names fit into kMaxNameBytes, the text ends with the number of the missing ones, as in
/// "L1 + L2 + 3 more".
std::string material_name(const LabelNames& names, const Labels& wanted, int first_label);

}  // namespace trocar::pipeline
