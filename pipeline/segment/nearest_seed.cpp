// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/segment/nearest_seed.h"

#include <limits>
#include <queue>
#include <tuple>

#include "pipeline/segment/plane_flood.h"

namespace trocar::pipeline {
namespace {

// Calls visit(neighbour, distance in mm) for each of the 6 neighbours in the grid.
template <typename Visit>
void each_neighbour(const VoxelGrid& grid, std::size_t voxel, const Visit& visit) {
  std::size_t stride = 1;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::vector<double>& at = grid.at_mm[axis];
    const std::size_t i = voxel / stride % at.size();
    if (i > 0) visit(voxel - stride, at[i] - at[i - 1]);
    if (i + 1 < at.size()) visit(voxel + stride, at[i + 1] - at[i]);
    stride *= at.size();
  }
}

}  // namespace

void keep_near(const VoxelGrid& grid, const std::vector<std::uint8_t>& near, double margin_mm,
               std::vector<std::uint8_t>& material) {
  std::vector<float> apart2;
  squared_distances(grid.at_mm, near, apart2);
  for (std::size_t i = 0; i < material.size(); ++i)
    if (static_cast<double>(apart2[i]) > margin_mm * margin_mm * (1 + 1e-6)) material[i] = 0;
}

void keep_nearest_to_first(const VoxelGrid& grid, const std::vector<std::size_t>& seeds,
                           std::vector<std::uint8_t>& material) {
  using Step = std::tuple<double, std::uint32_t, std::size_t>;  // length of the path, seed, voxel
  std::priority_queue<Step, std::vector<Step>, std::greater<>> front;
  constexpr auto kNobody = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> owner(material.size(), kNobody);
  for (std::size_t s = 0; s < seeds.size(); ++s)
    front.emplace(0.0, static_cast<std::uint32_t>(s), seeds[s]);
  while (!front.empty()) {
    const Step step = front.top();
    front.pop();
    const std::size_t voxel = std::get<2>(step);
    if (owner[voxel] != kNobody) continue;
    owner[voxel] = std::get<1>(step);
    each_neighbour(grid, voxel, [&](std::size_t other, double apart) {
      if (material[other] != 0 && owner[other] == kNobody)
        front.emplace(std::get<0>(step) + apart, std::get<1>(step), other);
    });
  }
  for (std::size_t i = 0; i < material.size(); ++i)
    material[i] = owner[i] == 0 ? 1 : 0;
}

}  // namespace trocar::pipeline
