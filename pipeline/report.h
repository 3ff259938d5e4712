// SPDX-License-Identifier: GPL-3.0-or-later
// The report of a run (--report), the measures of a slice that the asset stores, and the stages of
// one slice for pictures (--dump-stages).
#pragma once

#include <nlohmann/json.hpp>

#include "pipeline/mesh_slice.h"

namespace trocar::pipeline {

/// One entry of `slices[]`.
nlohmann::json slice_report(int index, double z_mm, const MeshedSlice& slice);

/// The part of it that the asset stores: only what does not change from run to run (no times).
nlohmann::json slice_measures(const MeshedSlice& slice);

/// Contours, PSLG, constrained Delaunay triangulation and refined mesh of a slice, in mm.
nlohmann::json slice_stages(int index, const SlicePlane& plane, const MeshedSlice& slice,
                            const Lattice& lattice);

nlohmann::json to_json(const Warning& warning);

/// Peak resident memory of this process so far.
std::uint64_t peak_rss_bytes();

}  // namespace trocar::pipeline
