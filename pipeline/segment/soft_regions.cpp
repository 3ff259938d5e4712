// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/segment/soft_regions.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "pipeline/segment/plane_flood.h"

namespace trocar::pipeline {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::array kDepths_mm = {7.0, 4.0};
constexpr double kMinRegion_mm3 = 300;
constexpr double kSurface_mm = 1.3 * kBlock_mm;  // blocks nearer to the outside are at the surface
constexpr double kNoise_HU = 30;  // a region whose mean is this far below the threshold counts too
constexpr double kSpread_HU = 100;  // of values above a region's mean that still belong to it

float squared(double mm) {
  return static_cast<float>(mm * mm);
}

class Search {
 public:
  Search(const BlockMeans& means, double threshold_HU)
      : grid_(means.grid()), hu_(means.hu()), material_(grid_.size()) {
    for (std::size_t i = 0; i < hu_.size(); ++i)
      material_[i] = hu_[i] >= static_cast<float>(threshold_HU - kNoise_HU) ? 1 : 0;
    Bytes outside(material_.size());
    std::transform(material_.begin(), material_.end(), outside.begin(),
                   [](std::uint8_t m) { return static_cast<std::uint8_t>(1 - m); });
    squared_distances(grid_.at_mm, outside, depth2_);
  }

  SoftRegions run() {
    nearest_.assign(hu_.size(), static_cast<float>(kSurface_mm));
    taken_.assign(hu_.size(), 0);
    out_.limit_HU.assign(hu_.size(), 0);
    for (const double depth_mm : kDepths_mm)
      search(depth_mm);
    if (out_.count > 0) measure();
    return std::move(out_);
  }

 private:
  void search(double depth_mm) {
    Bytes deep(hu_.size());
    for (std::size_t i = 0; i < deep.size(); ++i)
      deep[i] = depth2_[i] > squared(depth_mm) && taken_[i] == 0 ? 1 : 0;
    const VoxelComponents regions = find_components(grid_, deep);
    Bytes now = taken_;
    for (std::uint32_t r = 0; r < regions.volume_mm3.size(); ++r) {
      if (regions.volume_mm3[r] < kMinRegion_mm3) continue;
      Bytes core(hu_.size(), 0);
      for (const VoxelComponents::Run& run : regions.runs) {
        if (run.component != r) continue;
        std::fill(core.begin() + static_cast<std::ptrdiff_t>(run.begin),
                  core.begin() + static_cast<std::ptrdiff_t>(run.end), std::uint8_t{1});
      }
      assign(core, depth_mm, now);
    }
    taken_ = std::move(now);
  }

  // Gives a region the blocks that are nearer to it than to earlier ones.
  void assign(const Bytes& core, double depth_mm, Bytes& taken) {
    std::vector<float> apart2;
    squared_distances(grid_.at_mm, core, apart2);
    double sum = 0, count = 0, shell_sum = 0, shell_count = 0;
    for (std::size_t i = 0; i < core.size(); ++i) {
      if (core[i] != 0) sum += double{hu_[i]}, count += 1;
      if (material_[i] == 0 || apart2[i] > squared(depth_mm + kSurface_mm)) continue;
      taken[i] = 1;
      if (depth2_[i] <= squared(kSurface_mm)) shell_sum += double{hu_[i]}, shell_count += 1;
    }
    if (shell_count == 0) return;
    const double mean = sum / count;
    const bool is_soft = mean < kMaxSoft_HU && shell_sum / shell_count < mean;
    for (std::size_t i = 0; i < core.size(); ++i) {
      if (material_[i] == 0) continue;
      const auto apart = static_cast<float>(std::sqrt(double{apart2[i]}) - depth_mm);
      if (!(apart < nearest_[i])) continue;
      nearest_[i] = apart;
      out_.limit_HU[i] = static_cast<std::uint16_t>(is_soft ? mean + kSpread_HU : 0);
    }
    if (!is_soft) return;
    out_.low_HU = out_.count == 0 ? mean : std::min(out_.low_HU, mean);
    out_.high_HU = std::max(out_.high_HU, mean);
    ++out_.count;
  }

  // The volume, and whether bone is connected with it.
  void measure() {
    const VoxelComponents parts = find_components(grid_, material_);
    std::vector<double> soft(parts.volume_mm3.size(), 0);
    for (const VoxelComponents::Run& run : parts.runs) {
      for (std::size_t i = run.begin; i < run.end; ++i) {
        if (out_.limit_HU[i] == 0) continue;
        const std::size_t nx = grid_.count(0), ny = grid_.count(1);
        soft[run.component] += grid_.width_mm(0, i % nx) * grid_.width_mm(1, i / nx % ny) *
                               grid_.width_mm(2, i / nx / ny);
      }
    }
    constexpr double kBone_mm3 = 1000;
    for (std::size_t c = 0; c < soft.size(); ++c) {
      out_.volume_mm3 += soft[c];
      if (soft[c] > 0 && parts.volume_mm3[c] - soft[c] > kBone_mm3) out_.touches_bone = true;
    }
  }

  const VoxelGrid& grid_;
  const std::vector<float>& hu_;
  Bytes material_, taken_;
  std::vector<float> depth2_, nearest_;
  SoftRegions out_;
};

}  // namespace

BlockMeans::BlockMeans(const VoxelGrid& grid) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::vector<double>& at = grid.at_mm[axis];
    const std::size_t n = voxels_[axis] = at.size();
    const double step = n > 1 ? (at.back() - at.front()) / static_cast<double>(n - 1) : kBlock_mm;
    size_[axis] = std::clamp<std::size_t>(
        static_cast<std::size_t>(std::lround(std::min(kBlock_mm / step, 1e6))), 1, n);
    for (std::size_t i = 0; i + size_[axis] <= n; i += size_[axis])
      blocks_.at_mm[axis].push_back((at[i] + at[i + size_[axis] - 1]) / 2);
  }
  hu_.assign(blocks_.count(0) * blocks_.count(1) * voxels_[2], 0);
}

void BlockMeans::add(std::size_t slice, const Image& image) {
  const std::size_t nx = blocks_.count(0), ny = blocks_.count(1);
  std::vector<double> sums(nx);
  for (std::size_t by = 0; by < ny; ++by) {
    std::fill(sums.begin(), sums.end(), 0.0);
    for (std::size_t y = by * size_[1]; y < (by + 1) * size_[1]; ++y) {
      const float* row = &image.values[y * voxels_[0]];
      for (std::size_t bx = 0; bx < nx; ++bx)
        for (std::size_t x = bx * size_[0]; x < (bx + 1) * size_[0]; ++x)
          sums[bx] += double{row[x]};
    }
    for (std::size_t bx = 0; bx < nx; ++bx)
      hu_[(slice * ny + by) * nx + bx] =
          static_cast<float>(sums[bx] / static_cast<double>(size_[0] * size_[1]));
  }
}

void BlockMeans::finish() {
  const std::size_t plane = blocks_.count(0) * blocks_.count(1);
  for (std::size_t z = 0; z < blocks_.count(2); ++z) {
    for (std::size_t i = 0; i < plane; ++i) {
      double sum = 0;
      for (std::size_t k = z * size_[2]; k < (z + 1) * size_[2]; ++k)
        sum += double{hu_[k * plane + i]};
      hu_[z * plane + i] = static_cast<float>(sum / static_cast<double>(size_[2]));
    }
  }
  hu_.resize(plane * blocks_.count(2));
  hu_.shrink_to_fit();
}

SoftRegions find_soft_regions(const BlockMeans& means, double threshold_HU) {
  return Search(means, threshold_HU).run();
}

}  // namespace trocar::pipeline
