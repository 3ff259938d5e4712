// SPDX-License-Identifier: GPL-3.0-or-later
// The planes of a volume that are perpendicular to one of its axes. Each plane can be read and
// written as an image.
#pragma once

#include <cstddef>

#include "pipeline/segment/connected_components.h"
#include "pipeline/segment/plane_flood.h"

namespace trocar::pipeline {

/// The planes perpendicular to the axis `across`. Column x of a plane is voxel x along the axis
/// `u`, and row y is voxel y along the axis `v`.
struct VoxelPlanes {
  const VoxelGrid& grid;
  std::size_t across, u, v;

  VoxelPlanes(const VoxelGrid& of, std::size_t axis)
      : grid(of), across(axis), u(axis == 0 ? 1 : 0), v(axis == 2 ? 1 : 2) {}
  std::size_t count() const { return grid.count(across); }
  PlaneGrid plane() const { return {grid.at_mm[u], grid.at_mm[v]}; }
  std::size_t width() const { return grid.count(u); }
  std::size_t height() const { return grid.count(v); }
  std::size_t stride(std::size_t axis) const {
    return axis == 0 ? 1 : axis == 1 ? grid.count(0) : grid.count(0) * grid.count(1);
  }
  std::size_t voxel(std::size_t plane, std::size_t x, std::size_t y) const {
    return plane * stride(across) + x * stride(u) + y * stride(v);
  }
  /// Calls visit(index in the plane, index in the volume) for each pixel of a plane.
  template <typename Visit>
  void each(std::size_t plane, const Visit& visit) const {
    std::size_t i = 0;
    for (std::size_t y = 0; y < height(); ++y) {
      std::size_t at = voxel(plane, 0, y);
      for (std::size_t x = 0; x < width(); ++x, at += stride(u))
        visit(i++, at);
    }
  }
};

}  // namespace trocar::pipeline
