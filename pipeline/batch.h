// SPDX-License-Identifier: GPL-3.0-or-later
// A whole scan: every slice meshed, slices in parallel, into one asset and one report.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "formats/asset/asset.h"
#include "pipeline/display_surface.h"
#include "pipeline/label_names.h"
#include "pipeline/mesh_slice.h"

namespace trocar::pipeline {

struct BatchOptions {
  MeshOptions mesh;
  SolidOptions solid;
  LabelNames names;                           ///< of a label map; the scan's own are added to them
  std::optional<SurfaceOptions> surface;      ///< also a surface for display
  std::optional<SliceAxis> axis;              ///< that the stack was opened along
  std::optional<std::pair<int, int>> slices;  ///< first and last index, both included
  int threads = 0;                            ///< 0: all cores
  std::vector<std::uint8_t> input_key;        ///< of the input's digest; empty: no digest
  bool lines = false;                         ///< Asset::lines
  bool colours = false;                       ///< Asset::colours
  std::optional<int> dump_slice;              ///< keep this slice's stages for pictures
  std::function<void(int done, int total)> progress;  ///< called from any thread, one at a time
  const std::atomic<bool>* stop = nullptr;            ///< set from a signal handler: stop early
  /// Start of the report's total_ms, which includes opening the scan.
  std::chrono::steady_clock::time_point start = std::chrono::steady_clock::now();
};

struct BatchResult {
  std::string input_key_digest;  ///< empty without a key
  std::vector<std::uint8_t> glb;
  nlohmann::json report;
  nlohmann::json stages;  ///< of dump_slice, or null
};

/// Errors (usage): slices or crop outside the stack, colours without HU.
Result<void> check_ranges(const SliceStack& stack, const BatchOptions& options);

/// The same stack and options give the same glb, with any number of threads. Errors: those of
/// mesh_slice(), the lowest slice's first; (refused) no slice has any material; (usage) slices or
/// crop outside the stack; (unwritable) stopped.
/// The report's warnings are the stack's, those of slices, voxel_volume (read/voxel_volume.h) and
/// those of label_guess.h. Report and asset say so if values are not HU (formats/asset/asset.md).
Result<BatchResult> mesh_stack(const SliceStack& stack, const BatchOptions& options,
                               const nlohmann::json& parameters);

}  // namespace trocar::pipeline
