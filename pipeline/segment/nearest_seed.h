// SPDX-License-Identifier: GPL-3.0-or-later
// Selects material by distance: near a set of voxels, or nearest to a seed.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "pipeline/segment/connected_components.h"

namespace trocar::pipeline {

/// Removes the voxels of `material` whose centres are farther than `margin_mm` from the centre of
/// every voxel of `near`. O(voxels * margin / voxel width).
void keep_near(const VoxelGrid& grid, std::vector<std::uint8_t>& near, double margin_mm,
               std::vector<std::uint8_t>& material);

/// Keeps the material that belongs to the first seed. Each seed is the index of a voxel. A path
/// leads from voxel to voxel through faces and stays in the material. A voxel belongs to the
/// seed to which it has the shortest path; if two paths are equally long, to the earlier seed. The
/// length of such a path adds up steps along x, y and z. If a seed lies straight above another, the
/// border between them is therefore horizontal. O(voxels log voxels).
void keep_nearest_to_first(const VoxelGrid& grid, const std::vector<std::size_t>& seeds,
                           std::vector<std::uint8_t>& material);

}  // namespace trocar::pipeline
