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
    std::vector<std::vector<VoxelComponents::Run>> runs(regions.volume_mm3.size());
    for (const VoxelComponents::Run& run : regions.runs)
      if (regions.volume_mm3[run.component] >= kMinRegion_mm3) runs[run.component].push_back(run);
    Bytes now = taken_;
    for (const std::vector<VoxelComponents::Run>& core : runs)
      if (!core.empty()) assign(core, depth_mm, now);
    taken_ = std::move(now);
  }

  // A box of blocks: along each axis from a first one to before the last.
  struct Box {
    std::array<std::size_t, 3> from{}, to{};
    std::array<std::vector<double>, 3> at_mm;
  };

  // The blocks that are within a distance of the core along each axis.
  Box box_around(const std::vector<VoxelComponents::Run>& core, double margin_mm) const {
    Box out;
    out.from.fill(grid_.size());
    const std::size_t nx = grid_.count(0), ny = grid_.count(1);
    for (const VoxelComponents::Run& run : core) {
      const std::array first{run.begin % nx, run.begin / nx % ny, run.begin / nx / ny};
      const std::array last{(run.end - 1) % nx + 1, first[1] + 1, first[2] + 1};
      for (std::size_t axis = 0; axis < 3; ++axis) {
        out.from[axis] = std::min(out.from[axis], first[axis]);
        out.to[axis] = std::max(out.to[axis], last[axis]);
      }
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::vector<double>& at = grid_.at_mm[axis];
      std::size_t &from = out.from[axis], &to = out.to[axis];
      const double low = at[from] - margin_mm, high = at[to - 1] + margin_mm;
      while (from > 0 && at[from - 1] >= low)
        --from;
      while (to < at.size() && at[to] <= high)
        ++to;
      out.at_mm[axis].assign(at.begin() + static_cast<std::ptrdiff_t>(from),
                             at.begin() + static_cast<std::ptrdiff_t>(to));
    }
    return out;
  }

  // Calls visit(index in the box, index in the volume) for each block of a box.
  template <typename Visit>
  void each_in(const Box& box, const Visit& visit) const {
    std::size_t here = 0;
    for (std::size_t z = box.from[2]; z < box.to[2]; ++z)
      for (std::size_t y = box.from[1]; y < box.to[1]; ++y)
        for (std::size_t x = box.from[0]; x < box.to[0]; ++x)
          visit(here++, (z * grid_.count(1) + y) * grid_.count(0) + x);
  }

  // Gives a region the blocks that are nearer to it than to earlier ones. Those farther than kFar
  // keep their owner.
  void assign(const std::vector<VoxelComponents::Run>& runs, double depth_mm, Bytes& taken) {
    constexpr double kFar = 1 + 1e-6;  // a little more than the distance that is compared with
    const Box box = box_around(runs, (depth_mm + kSurface_mm) * kFar);
    const std::size_t width = box.at_mm[0].size(), height = box.at_mm[1].size();
    Bytes core(width * height * box.at_mm[2].size(), 0);
    for (const VoxelComponents::Run& run : runs) {
      const std::size_t row = run.begin / grid_.count(0),
                        first = row * grid_.count(0) + box.from[0];
      const std::size_t y = row % grid_.count(1) - box.from[1],
                        z = row / grid_.count(1) - box.from[2];
      const auto to = core.begin() + static_cast<std::ptrdiff_t>((z * height + y) * width);
      std::fill(to + static_cast<std::ptrdiff_t>(run.begin - first),
                to + static_cast<std::ptrdiff_t>(run.end - first), std::uint8_t{1});
    }
    std::vector<float> apart2;
    squared_distances(box.at_mm, core, apart2);
    double sum = 0, count = 0, shell_sum = 0, shell_count = 0;
    each_in(box, [&](std::size_t here, std::size_t i) {
      if (core[here] != 0) sum += double{hu_[i]}, count += 1;
      if (material_[i] == 0 || apart2[here] > squared(depth_mm + kSurface_mm)) return;
      taken[i] = 1;
      if (depth2_[i] <= squared(kSurface_mm)) shell_sum += double{hu_[i]}, shell_count += 1;
    });
    if (shell_count == 0) return;
    const double mean = sum / count;
    const bool is_soft = mean < kMaxSoft_HU && shell_sum / shell_count < mean;
    const auto limit_HU =
        static_cast<std::uint16_t>(is_soft ? std::max(mean + kSpread_HU, 1.0) : 0.0);
    each_in(box, [&](std::size_t here, std::size_t i) {
      if (material_[i] == 0) return;
      const auto apart = static_cast<float>(std::sqrt(double{apart2[here]}) - depth_mm);
      if (!(apart < nearest_[i])) return;
      nearest_[i] = apart;
      out_.limit_HU[i] = limit_HU;
    });
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
