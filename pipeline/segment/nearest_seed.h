// SPDX-License-Identifier: GPL-3.0-or-later
// Selects material by distance: near a set of voxels, or nearest to a seed.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "pipeline/segment/connected_components.h"

namespace trocar::pipeline {

/// Removes the material whose voxel centres are farther than `margin_mm` from every voxel of
/// `near`. O(voxels * (margin / voxel width)^2).
void keep_near(const VoxelGrid& grid, std::vector<std::uint8_t>& near, double margin_mm,
               std::vector<std::uint8_t>& material);

/// Keeps the material that belongs to the first seed. Each seed is the index of a voxel. A voxel
/// belongs to a seed if it is connected to the seed by faces and its path to the seed, within the
/// material, is shorter than to any other seed. At equal lengths the earlier seed wins. A path goes
/// from voxel to voxel through faces, so the border between seeds one above the other is level.
/// O(voxels log voxels).
void keep_nearest_to_first(const VoxelGrid& grid, const std::vector<std::size_t>& seeds,
                           std::vector<std::uint8_t>& material);

}  // namespace trocar::pipeline
