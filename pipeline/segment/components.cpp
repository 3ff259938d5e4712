// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/segment/components.h"

#include <algorithm>
#include <initializer_list>
#include <queue>
#include <tuple>

#include "formats/base/disjoint_sets.h"

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

constexpr double kInfinite = std::numeric_limits<double>::infinity();

// The lower envelope of parabolas (x - at[i])^2 + height[i], evaluated at every at[i].
class LowerEnvelope {
 public:
  void run(std::span<const double> at, std::vector<double>& height) {
    const std::size_t n = at.size();
    apex_.resize(n);
    begin_.resize(n + 1);
    std::size_t count = 0;
    for (std::size_t i = 0; i < n; ++i) {
      if (height[i] == kInfinite) continue;
      double from = -kInfinite;
      while (count > 0) {
        const std::size_t j = apex_[count - 1];
        from = ((height[i] + at[i] * at[i]) - (height[j] + at[j] * at[j])) / (2 * (at[i] - at[j]));
        if (from > begin_[count - 1]) break;
        --count;
        from = -kInfinite;
      }
      apex_[count] = i;
      begin_[count++] = from;
    }
    if (count == 0) return;
    value_.resize(n);
    std::size_t k = 0;
    for (std::size_t i = 0; i < n; ++i) {
      while (k + 1 < count && begin_[k + 1] < at[i])
        ++k;
      const double step = at[i] - at[apex_[k]];
      value_[i] = step * step + height[apex_[k]];
    }
    height.swap(value_);
  }

 private:
  std::vector<std::size_t> apex_;
  std::vector<double> begin_, value_;
};

// Squared distances in a grid whose first axis is that of neighbouring values.
void squared_distances_along(std::initializer_list<std::span<const double>> axes,
                             std::span<const std::uint8_t> set, std::vector<float>& squared_mm2) {
  squared_mm2.resize(set.size());
  std::transform(set.begin(), set.end(), squared_mm2.begin(), [](std::uint8_t s) {
    return s != 0 ? 0.0F : std::numeric_limits<float>::infinity();
  });
  LowerEnvelope envelope;
  std::vector<double> line;
  std::size_t stride = 1;
  for (const std::span<const double> at : axes) {
    line.resize(at.size());
    for (std::size_t block = 0; block < set.size(); block += stride * at.size()) {
      for (std::size_t first = block; first < block + stride; ++first) {
        for (std::size_t i = 0; i < line.size(); ++i)
          line[i] = static_cast<double>(squared_mm2[first + i * stride]);
        envelope.run(at, line);
        for (std::size_t i = 0; i < line.size(); ++i)
          squared_mm2[first + i * stride] = static_cast<float>(line[i]);
      }
    }
    stride *= at.size();
  }
}

// Collects the pixels connected by edges with `start` whose `open` is 1, and sets their `open` to
// 0.
void take_patch(const PlaneGrid& grid, std::size_t start, std::vector<std::uint8_t>& open,
                std::vector<std::size_t>& patch) {
  const std::size_t width = grid.u_mm.size(), height = grid.v_mm.size();
  patch.assign(1, start);
  open[start] = 0;
  for (std::size_t next = 0; next < patch.size(); ++next) {
    const std::size_t i = patch[next], x = i % width, y = i / width;
    const auto add = [&](bool exists, std::size_t neighbour) {
      if (!exists || open[neighbour] == 0) return;
      open[neighbour] = 0;
      patch.push_back(neighbour);
    };
    add(x > 0, i - 1);
    add(x + 1 < width, i + 1);
    add(y > 0, i - width);
    add(y + 1 < height, i + width);
  }
}

// squared_distances() as far as `limit_mm`; larger ones are infinite. Without envelopes, since
// the pixels within a short distance are few. O(pixels * limit / spacing).
class NearDistances {
 public:
  void run(const PlaneGrid& grid, double limit_mm, std::span<const std::uint8_t> set,
           std::vector<float>& squared_mm2) {
    grid_ = grid;
    limit2_ = limit_mm * limit_mm;
    const std::size_t width = grid_.u_mm.size(), height = grid_.v_mm.size();
    along_rows_.resize(set.size());
    is_empty_.assign(height, 1);
    for (std::size_t y = 0; y < height; ++y)
      is_empty_[y] = run_row(&set[y * width], &along_rows_[y * width]) ? 0 : 1;
    squared_mm2.resize(set.size());
    for (std::size_t y = 0; y < height; ++y) {
      row_.assign(width, kInfinite);
      for (std::size_t other = y + 1; other-- > 0;)
        if (!take_row(y, other)) break;
      for (std::size_t other = y + 1; other < height; ++other)
        if (!take_row(y, other)) break;
      float* out = &squared_mm2[y * width];
      for (std::size_t x = 0; x < width; ++x)
        out[x] = row_[x] <= limit2_ ? static_cast<float>(row_[x])
                                    : std::numeric_limits<float>::infinity();
    }
  }

 private:
  // Squared distances along a row. Returns whether any is within the limit.
  bool run_row(const std::uint8_t* set, float* out) const {
    const std::size_t width = grid_.u_mm.size();
    std::fill(out, out + width, std::numeric_limits<float>::infinity());
    bool any = false;
    for (std::size_t x = 0; x < width; ++x) {
      if (set[x] == 0) continue;
      any = true;
      out[x] = 0;
      const auto take = [&](std::size_t other) {
        const double step = grid_.u_mm[other] - grid_.u_mm[x];
        if (set[other] != 0 || step * step > limit2_) return false;
        out[other] = std::min(out[other], static_cast<float>(step * step));
        return true;
      };
      for (std::size_t other = x; other-- > 0;)
        if (!take(other)) break;
      for (std::size_t other = x + 1; other < width; ++other)
        if (!take(other)) break;
    }
    return any;
  }

  // Takes the distances to another row into row_. Returns whether that row is within the limit.
  bool take_row(std::size_t y, std::size_t other) {
    const double step = grid_.v_mm[y] - grid_.v_mm[other], step2 = step * step;
    if (step2 > limit2_) return false;
    if (is_empty_[other] != 0) return true;
    const float* from = &along_rows_[other * row_.size()];
    for (std::size_t x = 0; x < row_.size(); ++x)
      row_[x] = std::min(row_[x], step2 + static_cast<double>(from[x]));
    return true;
  }

  PlaneGrid grid_;
  double limit2_ = 0;
  std::vector<float> along_rows_;
  std::vector<std::uint8_t> is_empty_;
  std::vector<double> row_;
};

}  // namespace

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

void keep_near(const VoxelGrid& grid, std::span<const std::uint8_t> near, double margin_mm,
               std::vector<std::uint8_t>& material) {
  std::vector<float> apart2;
  squared_distances(grid.at_mm, near, apart2);
  const auto most2 = static_cast<float>(margin_mm * margin_mm * (1 + 1e-6));  // against rounding
  for (std::size_t i = 0; i < material.size(); ++i)
    if (apart2[i] > most2) material[i] = 0;
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

void squared_distances(const PlaneGrid& grid, std::span<const std::uint8_t> set,
                       std::vector<float>& squared_mm2) {
  squared_distances_along({grid.u_mm, grid.v_mm}, set, squared_mm2);
}

void squared_distances(const std::array<std::vector<double>, 3>& at_mm,
                       std::span<const std::uint8_t> set, std::vector<float>& squared_mm2) {
  squared_distances_along({at_mm[0], at_mm[1], at_mm[2]}, set, squared_mm2);
}

void find_enclosed(const PlaneGrid& grid, std::span<const std::uint8_t> solid, double radius_mm,
                   double largest_mm2, std::vector<std::uint8_t>& enclosed, double near_mm,
                   std::vector<float>* near_mm2) {
  const std::size_t width = grid.u_mm.size(), height = grid.v_mm.size();
  enclosed.assign(grid.size(), 0);
  if (near_mm2 != nullptr) near_mm2->assign(grid.size(), std::numeric_limits<float>::infinity());
  if (std::all_of(solid.begin(), solid.end(), [](std::uint8_t s) { return s == 0; })) return;
  // The limit is slightly above the radius, so that an equal distance does not depend on rounding.
  const double limit_mm = radius_mm * (1 + 1e-6);
  const auto squared = static_cast<float>(limit_mm * limit_mm);
  const double far_mm = std::max(limit_mm, near_mm) * (1 + 1e-6);
  constexpr double kNear = 32;  // pixels, above which envelopes are faster
  const bool is_near =
      far_mm < kNear * std::min(cell_width(grid.u_mm, 0), cell_width(grid.v_mm, 0));
  // A thread keeps its memory, because a caller has hundreds of planes.
  thread_local NearDistances near;
  thread_local std::vector<float> distance;
  thread_local std::vector<std::uint8_t> open, reached, barred, outside;
  thread_local std::vector<std::size_t> patch;
  const auto measure = [&](std::span<const std::uint8_t> set) {
    is_near ? near.run(grid, far_mm, set, distance) : squared_distances(grid, set, distance);
  };
  measure(solid);
  if (near_mm2 != nullptr) *near_mm2 = distance;
  open.resize(grid.size());
  reached.assign(grid.size(), 0);
  for (std::size_t i = 0; i < open.size(); ++i)
    open[i] = distance[i] > squared ? 1 : 0;

  // Moves what is connected with the border from `open` to `reached`.
  const auto flood = [&] {
    const auto flood_from = [&](std::size_t start) {
      if (open[start] == 0) return;
      take_patch(grid, start, open, patch);
      for (const std::size_t i : patch)
        reached[i] = 1;
    };
    for (std::size_t x = 0; x < width; ++x) {
      flood_from(x);
      flood_from((height - 1) * width + x);
    }
    for (std::size_t y = 0; y < height; ++y) {
      flood_from(y * width);
      flood_from(y * width + width - 1);
    }
  };
  flood();
  barred = open;  // where the disc fits but cannot come

  measure(reached);
  outside.clear();
  if (radius_mm > 0) {  // otherwise nothing that is connected with the border is enclosed
    for (std::size_t i = 0; i < open.size(); ++i)
      open[i] = solid[i] == 0 ? 1 : 0;
    reached.assign(grid.size(), 0);
    flood();
    outside.swap(reached);
  }
  for (std::size_t i = 0; i < open.size(); ++i)
    open[i] = solid[i] == 0 && distance[i] > squared ? 1 : 0;
  for (std::size_t start = 0; start < open.size(); ++start) {
    if (open[start] == 0) continue;
    take_patch(grid, start, open, patch);
    double area_mm2 = 0;
    for (const std::size_t i : patch)
      area_mm2 += cell_width(grid.u_mm, i % width) * cell_width(grid.v_mm, i / width);
    if (area_mm2 > largest_mm2) continue;
    const bool is_behind_gap =
        std::any_of(patch.begin(), patch.end(), [&](std::size_t i) { return barred[i] != 0; });
    const Enclosure how = outside.empty() || outside[start] == 0 ? kSurrounded
                          : is_behind_gap                        ? kBehindGap
                                                                 : kInCrevice;
    for (const std::size_t i : patch)
      enclosed[i] = how;
  }
}

}  // namespace trocar::pipeline
