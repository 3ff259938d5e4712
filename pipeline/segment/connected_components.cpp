// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/segment/connected_components.h"

#include "formats/base/disjoint_sets.h"

namespace trocar::pipeline {

VoxelGrid grid_of(const SliceStack& stack) {
  VoxelGrid grid;
  const SlicePlane& first = stack.plane(0);
  for (int x = 0; x < stack.width(); ++x)
    grid.at_mm[0].push_back(x * first.spacing_u_mm);
  for (int y = 0; y < stack.height(); ++y)
    grid.at_mm[1].push_back(y * first.spacing_v_mm);
  for (int k = 0; k < stack.size(); ++k)
    grid.at_mm[2].push_back(stack.plane(k).z_mm);
  return grid;
}

VoxelRuns find_runs(const std::array<std::size_t, 3>& size, std::span<const std::uint8_t> voxels,
                    bool by_corners) {
  const std::size_t nx = size[0], ny = size[1], nz = size[2];
  VoxelRuns out;
  std::vector<std::size_t> first(ny * nz + 1);  // index of each row's first run
  for (std::size_t row = 0; row < ny * nz; ++row) {
    first[row] = out.runs.size();
    const std::size_t end = (row + 1) * nx;
    for (std::size_t i = row * nx; i < end;) {
      if (voxels[i] == 0) {
        ++i;
        continue;
      }
      VoxelRuns::Run run{i, i, 0};
      while (run.end < end && voxels[run.end] != 0)
        ++run.end;
      i = run.end;
      out.runs.push_back(run);
    }
  }
  first[ny * nz] = out.runs.size();

  DisjointSets sets(out.runs.size());
  // Joins the runs of two rows that share a face, or a corner. `apart` is the offset from a voxel
  // of `other` to the voxel of `row` at the same x.
  const std::size_t reach = by_corners ? 1 : 0;
  const auto join_rows = [&](std::size_t row, std::size_t other, std::size_t apart) {
    std::size_t a = first[row], b = first[other];
    while (a < first[row + 1] && b < first[other + 1]) {
      const auto &r = out.runs[a], &s = out.runs[b];
      if (r.begin < s.end + apart + reach && s.begin + apart < r.end + reach)
        sets.join(static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b));
      (r.end < s.end + apart ? a : b) += 1;
    }
  };
  for (std::size_t z = 0; z < nz; ++z) {
    for (std::size_t y = 0; y < ny; ++y) {
      const std::size_t row = z * ny + y;
      if (y > 0) join_rows(row, row - 1, nx);
      if (z == 0) continue;
      if (by_corners && y > 0) join_rows(row, row - ny - 1, (ny + 1) * nx);
      join_rows(row, row - ny, ny * nx);
      if (by_corners && y + 1 < ny) join_rows(row, row - ny + 1, (ny - 1) * nx);
    }
  }
  for (std::size_t r = 0; r < out.runs.size(); ++r) {
    const std::uint32_t root = sets.root(static_cast<std::uint32_t>(r));
    out.runs[r].component =
        root == r ? static_cast<std::uint32_t>(out.components++) : out.runs[root].component;
  }
  return out;
}

VoxelComponents find_components(const VoxelGrid& grid, std::span<const std::uint8_t> voxels) {
  const std::size_t nx = grid.count(0), ny = grid.count(1);
  VoxelComponents out{find_runs({nx, ny, grid.count(2)}, voxels, true), {}};
  out.volume_mm3.resize(out.components, 0);
  for (const VoxelRuns::Run& run : out.runs) {
    const std::size_t row = run.begin / nx;
    const double area_mm2 = grid.width_mm(1, row % ny) * grid.width_mm(2, row / ny);
    for (std::size_t i = run.begin; i < run.end; ++i)
      out.volume_mm3[run.component] += area_mm2 * grid.width_mm(0, i % nx);
  }
  return out;
}

}  // namespace trocar::pipeline
