// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/segment/nearest_seed.h"

#include <algorithm>
#include <limits>
#include <queue>
#include <tuple>

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

void keep_near(const VoxelGrid& grid, std::vector<std::uint8_t>& near, double margin_mm,
               std::vector<std::uint8_t>& material) {
  // Works axis by axis. `left` is the largest remaining part of the squared margin at each voxel.
  // It is >= 0 after all axes if some voxel of `near` is within the margin.
  const auto none = -std::numeric_limits<float>::infinity();
  std::vector<float> left(grid.size(), none), line;
  for (std::size_t i = 0; i < near.size(); ++i)
    if (near[i] != 0) left[i] = static_cast<float>(margin_mm * margin_mm * (1 + 1e-6));
  std::size_t stride = 1;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::vector<double>& at = grid.at_mm[axis];
    const std::size_t n = at.size();
    line.resize(n);
    for (std::size_t start = 0; start < grid.size(); ++start) {
      if (start / stride % n != 0) continue;  // only the first voxel of each line
      for (std::size_t i = 0; i < n; ++i)
        line[i] = left[start + i * stride];
      for (std::size_t i = 0; i < n; ++i) {
        float best = line[i];
        for (const int way : {-1, 1}) {
          for (std::size_t k = i; way < 0 ? k > 0 : k + 1 < n;) {
            k = way < 0 ? k - 1 : k + 1;
            const double apart = at[k] - at[i];
            if (apart * apart > margin_mm * margin_mm * (1 + 1e-6)) break;
            best = std::max(best, line[k] - static_cast<float>(apart * apart));
          }
        }
        left[start + i * stride] = best >= 0 ? best : none;
      }
    }
    stride *= n;
  }
  for (std::size_t i = 0; i < material.size(); ++i)
    if (!(left[i] >= 0)) material[i] = 0;
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
