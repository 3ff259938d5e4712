// SPDX-License-Identifier: GPL-3.0-or-later
// Makes the report of a run (--report), the measures of a slice that the asset stores, and the
// contours, outlines and meshes of one slice for pictures (--dump-stages).
// Tests: tests/e2e/mesh_program_e2e_test.py
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "pipeline/scan/mesh_slice.h"

namespace trocar::pipeline {

/// An entry of the report's `slices[]`, without its times.
nlohmann::json slice_report(int index, double z_mm, const MeshedMaterial& material,
                            double max_area_bound_mm2);
nlohmann::json stage_times(const StageTimes& times);

/// The part of an entry of `slices[]` that the asset stores.
nlohmann::json slice_measures(const MeshedMaterial& material);

/// Contours, PSLG, constrained Delaunay triangulation and refined mesh of a slice, in mm. Those of
/// all materials are combined.
nlohmann::json slice_stages(int index, const SlicePlane& plane, const MeshedSlice& slice,
                            const Lattice& lattice);

/// The entry `asset` of the report, without the part about the surface. `bytes` is the size of the
/// file.
nlohmann::json asset_report(const AssetSizes& sizes, std::size_t bytes);

/// Largest resident memory that this process has used so far.
std::uint64_t peak_rss_bytes();

}  // namespace trocar::pipeline
