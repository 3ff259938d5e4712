// SPDX-License-Identifier: GPL-3.0-or-later
// Makes JSON from the results of a run: entries of the report (--report), the measures of a slice
// that the asset stores, and the data of one slice for pictures (--dump-stages).
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "pipeline/scan/mesh_slice.h"

namespace trocar::pipeline {

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
