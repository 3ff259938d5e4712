// SPDX-License-Identifier: GPL-3.0-or-later
// What can be done with a finished asset: describe it, or export it for other programs.
#pragma once

#include <atomic>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "formats/asset/asset.h"

namespace trocar::pipeline {

/// Counts, planes, areas, boxes, centroids, mean HU and parameters of an asset, slice by slice, and
/// the area of each material summed over the slices (formats/session/info.schema.json).
nlohmann::json describe_asset(const Asset& asset, std::uint64_t bytes);

/// Per non-empty slice `slice_NNNN.poly` (Triangle's format: the outline with a seed in each
/// hole), `.obj` (mm, in the patient's LPS frame) and `.svg`; of an asset with several materials
/// `slice_NNNN_M.poly` and so on for material number M. The folder is created if needed; an
/// export of the same slices in it is replaced. All files appear, or on failure none: (unwritable)
/// `stop`, if given, was set. Returns the names of files of an earlier export of other slices in
/// the folder: they are kept, and could be mistaken for this asset's.
Result<std::vector<std::string>> export_asset(const Asset& asset,
                                              const std::filesystem::path& folder,
                                              const std::atomic<bool>* stop = nullptr);

/// Each surface as binary `.stl`, binary `.ply` and `.obj`: mm, in the patient's LPS frame,
/// counter-clockwise seen from outside; `surface.stl`, or `surface_M.stl` of material M where there
/// are several. Otherwise as export_asset(). Refused if the asset has none.
Result<void> export_surfaces(const Asset& asset, const std::filesystem::path& folder,
                             const std::atomic<bool>* stop = nullptr);

}  // namespace trocar::pipeline
