// SPDX-License-Identifier: GPL-3.0-or-later
// Finds cavities that bone surrounds in every plane across an axis, such as marrow in a shaft. The
// end of the scan may cut them.
//
// A cavity is a set of voxels connected by faces. In its plane each of them is enclosed, and not
// only in a crevice (Enclosure in plane_flood.h). The cavity is closed if no voxel next to it along
// the axis is open, that is, neither material nor enclosed. What lies beyond the first and the last
// plane of the scan is unknown and does not count.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "pipeline/segment/connected_components.h"
#include "pipeline/segment/plane_flood.h"
#include "pipeline/segment/voxel_planes.h"

namespace trocar::pipeline {

struct Cavity {
  bool is_closed = true;
  bool is_cut = false;              ///< reaches the first or the last plane of the scan
  std::size_t first = 0, last = 0;  ///< planes
  std::size_t voxels = 0;
  std::size_t behind_gap = 0;  ///< voxels that are not kSurrounded
};

struct Cavities {
  VoxelRuns runs;
  std::vector<Cavity> cavities;  ///< by VoxelRuns::Run::component

  /// Calls visit(cavity, voxel) for every voxel of the cavities.
  template <typename Visit>
  void each(const Visit& visit) const {
    for (const VoxelRuns::Run& run : runs.runs)
      for (std::size_t i = run.begin; i < run.end; ++i)
        visit(run.component, i);
  }
};

/// Finds the cavities across the axis of `planes`. enclosure_of(voxel) returns the Enclosure of a
/// voxel in its plane, and is_bone(voxel) whether it is material. `has_first` and `has_last`:
/// whether the first and the last plane are those of the scan. O(voxels).
template <typename IsBone, typename EnclosureOf>
Cavities find_cavities(const VoxelPlanes& planes, bool has_first, bool has_last,
                       const IsBone& is_bone, const EnclosureOf& enclosure_of) {
  const VoxelGrid& grid = planes.grid;
  std::vector<std::uint8_t> inside(grid.size());
  for (std::size_t i = 0; i < inside.size(); ++i)
    inside[i] = enclosure_of(i) >= kBehindGap ? 1 : 0;
  Cavities out{find_runs({grid.count(0), grid.count(1), grid.count(2)}, inside, false), {}};
  out.cavities.resize(out.runs.components);
  const std::size_t stride = planes.stride(planes.across), last = planes.count() - 1;
  const auto is_open = [&](std::size_t i) {
    return !is_bone(i) && enclosure_of(i) == kNotEnclosed;
  };
  out.each([&](std::uint32_t component, std::size_t i) {
    Cavity& cavity = out.cavities[component];
    const std::size_t plane = i / stride % planes.count();
    cavity.first = cavity.voxels == 0 ? plane : std::min(cavity.first, plane);
    cavity.last = std::max(cavity.last, plane);
    ++cavity.voxels;
    cavity.behind_gap += enclosure_of(i) == kBehindGap ? 1 : 0;
    if (plane > 0 ? is_open(i - stride) : !has_first) cavity.is_closed = false;
    if (plane < last ? is_open(i + stride) : !has_last) cavity.is_closed = false;
    cavity.is_cut |= plane == 0 || plane == last;
  });
  return out;
}

}  // namespace trocar::pipeline
