// SPDX-License-Identifier: GPL-3.0-or-later
// The report of a run (--report), the measures of a slice that the asset stores, and the stages of
// one slice for pictures (--dump-stages).
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "pipeline/mesh_slice.h"

namespace trocar::pipeline {

/// One entry of `slices[]`, without times.
nlohmann::json slice_report(int index, double z_mm, const MeshedMaterial& material,
                            double max_area_bound_mm2);
nlohmann::json stage_times(const StageTimes& times);

/// The part of an entry that the asset stores.
nlohmann::json slice_measures(const MeshedMaterial& material);

/// Contours, PSLG, constrained Delaunay triangulation and refined mesh of a slice, in mm; those of
/// all materials together.
nlohmann::json slice_stages(int index, const SlicePlane& plane, const MeshedSlice& slice,
                            const Lattice& lattice);

/// A warning of one slice. A # in the sentence stands for `value`.
struct SliceWarning {
  std::string code;
  int slice = 0;
  std::string sentence;
  double value = 0;
};

/// `warnings[]`: an entry for each code, in the order in which the codes first occur: `code`,
/// `where`, `sentence`, and all its `slices` (numbers) or `places` (the texts of Warning::where).
/// Where the values of slices differ, the sentence has the lowest and the highest.
nlohmann::json warnings_json(const std::vector<Warning>& of_scan,
                             const std::vector<SliceWarning>& of_slices);

/// Peak resident memory of this process so far.
std::uint64_t peak_rss_bytes();

}  // namespace trocar::pipeline
