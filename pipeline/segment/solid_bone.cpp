// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/segment/solid_bone.h"

#include <bit>
#include <cmath>
#include <cstdio>
#include <numeric>

#include "pipeline/read/nrrd.h"
#include "pipeline/read/parallel_for.h"
#include "pipeline/segment/canals.h"
#include "pipeline/segment/label_pixels.h"

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

// A box of voxels: along each axis from a first one to before the last.
struct Box {
  std::array<std::size_t, 3> from{}, to{};
  VoxelGrid grid;

  // Nothing yet of a grid.
  explicit Box(const VoxelGrid& whole) : from{whole.count(0), whole.count(1), whole.count(2)} {}

  std::size_t row(const VoxelGrid& whole, std::size_t y, std::size_t z) const {
    return ((from[2] + z) * whole.count(1) + from[1] + y) * whole.count(0) + from[0];
  }
  // Extends the box to the voxels from `first` to before `last` of a row of the grid.
  void take(const VoxelGrid& whole, std::size_t row, std::size_t first, std::size_t last) {
    const std::size_t y = row % whole.count(1), z = row / whole.count(1);
    const std::array low{first, y, z}, high{last, y + 1, z + 1};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      from[axis] = std::min(from[axis], low[axis]);
      to[axis] = std::max(to[axis], high[axis]);
    }
  }
  // Sets the grid after all voxels were taken: adds a margin that is wider than margin_mm, as far as
  // the whole grid goes.
  void widen(const VoxelGrid& whole, double margin_mm) {
    for (std::size_t axis = 0; axis < 3 && to[axis] > 0; ++axis) {
      const std::vector<double>& at = whole.at_mm[axis];
      const double low = at[from[axis]] - margin_mm, high = at[to[axis] - 1] + margin_mm;
      while (from[axis] > 0 && at[from[axis]] >= low)
        --from[axis];
      while (to[axis] < at.size() && at[to[axis] - 1] <= high)
        ++to[axis];
      grid.at_mm[axis].assign(&at[from[axis]], at.data() + to[axis]);
    }
  }
};

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

  // The blocks that are within a distance of the core along each axis.
  Box box_around(const std::vector<VoxelComponents::Run>& core, double margin_mm) const {
    Box out(grid_);
    const std::size_t nx = grid_.count(0);
    for (const VoxelComponents::Run& run : core)
      out.take(grid_, run.begin / nx, run.begin % nx, (run.end - 1) % nx + 1);
    out.widen(grid_, margin_mm);
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
    const std::size_t width = box.grid.count(0), height = box.grid.count(1);
    Bytes core(box.grid.size(), 0);
    for (const VoxelComponents::Run& run : runs) {
      const std::size_t row = run.begin / grid_.count(0),
                        first = row * grid_.count(0) + box.from[0];
      const std::size_t y = row % grid_.count(1) - box.from[1],
                        z = row / grid_.count(1) - box.from[2];
      std::fill_n(&core[(z * height + y) * width + run.begin - first], run.end - run.begin,
                  std::uint8_t{1});
    }
    std::vector<float> apart2;
    squared_distances(box.grid.at_mm, core, apart2);
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
        soft[run.component] += grid_.mm3(i);
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

enum VoxelFlag : std::uint8_t { kMaterial = 1, kFillable = 2 };

bool has_hu(const SliceStack& stack, const Segmentation& how) {
  return stack.pixel_unit() == PixelUnit::kHounsfield && std::holds_alternative<Threshold>(how);
}

// Whether soft tissue above the threshold is searched for.
bool needs_soft_regions(const SliceStack& stack, const Segmentation& how,
                        const SolidOptions& options) {
  return has_hu(stack, how) && options.fill_mm2.has_value() &&
         std::get<Threshold>(how).value >= kMinBone_HU;
}

// The VoxelFlags of each voxel, one byte each; the upper six bits are packed_hu() of a scan in HU.
// Adds all slices to `means`, and the labels found to `labels`, if these are given.
Result<Bytes> segmented(const SliceStack& stack, const Segmentation& how, const VoxelGrid& grid,
                        BlockMeans* means = nullptr, std::set<int>* labels = nullptr) {
  const std::size_t pixels = grid.count(0) * grid.count(1);
  std::vector<std::set<int>> labels_of(static_cast<std::size_t>(stack.size()));
  Bytes out(grid.size());
  const bool is_hu = has_hu(stack, how);
  const auto ok = try_in_parallel(stack.size(), [&](int k) -> Result<void> {
    auto image = read_pixels(stack, k, how);
    if (!image) return image.error();
    if (means != nullptr) means->add(static_cast<std::size_t>(k), std::get<Image>(*image));
    Field field = segment(std::move(*image), stack.pixel_unit(), how);
    labels_of[static_cast<std::size_t>(k)] = std::move(field.labels);
    std::uint8_t* flags = &out[static_cast<std::size_t>(k) * pixels];
    for (std::size_t i = 0; i < pixels; ++i) {
      const float value = field.image.values[i];
      flags[i] = static_cast<std::uint8_t>((value >= field.iso ? kMaterial : 0) |
                                           (!is_hu || value >= kAir_HU ? kFillable : 0) |
                                           (is_hu ? packed_hu(value) : 0));
    }
    return {};
  });
  if (!ok) return ok.error();
  if (labels != nullptr)
    for (std::set<int>& slice : labels_of)
      labels->merge(slice);
  return out;
}

Bytes material_of(const Bytes& flags) {
  Bytes out(flags.size());
  for (std::size_t i = 0; i < out.size(); ++i)
    out[i] = (flags[i] & kMaterial) != 0 ? 1 : 0;
  return out;
}

bool holds_any(const Bytes& voxels) {
  return std::find(voxels.begin(), voxels.end(), 1) != voxels.end();
}

// Keeps the material of those of its components for which keep(component) holds.
template <typename Keep>
void keep_components(const VoxelComponents& components, const Keep& keep, Bytes& material) {
  for (const VoxelComponents::Run& run : components.runs) {
    if (!keep(run.component))
      std::fill_n(&material[run.begin], run.end - run.begin, std::uint8_t{0});
  }
}

void keep_largest(const VoxelGrid& grid, Bytes& material, int wanted) {
  const VoxelComponents components = find_components(grid, material);
  const std::vector<double>& volume = components.volume_mm3;
  std::vector<std::uint32_t> order(volume.size());
  std::iota(order.begin(), order.end(), 0U);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return volume[a] > volume[b]; });
  std::vector<bool> stays(volume.size(), false);
  for (std::size_t i = 0; i < order.size() && i < static_cast<std::size_t>(wanted); ++i)
    stays[order[i]] = true;
  keep_components(
      components, [&](std::uint32_t c) { return stays[c]; }, material);
}

// The axis of the volume that is nearest to the patient's long axis.
std::size_t column_axis(const SliceStack& stack) {
  const Eigen::Matrix3d axes = stack.plane(0).T_lps_plane.linear();
  std::size_t out = 2;  // if equal, the direction across the slices
  for (const std::size_t axis : {1U, 0U})
    if (std::abs(axes(2, axis)) > std::abs(axes(2, static_cast<Eigen::Index>(out)))) out = axis;
  return out;
}

// The box of the material with a margin that is wider than margin_mm, as far as the grid goes.
Box box_of(const VoxelGrid& grid, const Bytes& material, double margin_mm) {
  Box out(grid);
  const std::size_t nx = grid.count(0);
  for (std::size_t row = 0; row < grid.count(1) * grid.count(2); ++row) {
    const std::span<const std::uint8_t> line(&material[row * nx], nx);
    const auto first = std::find(line.begin(), line.end(), 1);
    if (first == line.end()) continue;
    const auto last = std::find(line.rbegin(), line.rend(), 1).base();
    out.take(grid, row, static_cast<std::size_t>(first - line.begin()),
             static_cast<std::size_t>(last - line.begin()));
  }
  out.widen(grid, margin_mm);
  return out;
}

// Flags of a voxel beside those of CanalFlag.
constexpr std::uint8_t
    kAlongOthers = 1 | 2,  // enclosed in a plane across one of the other two axes, a bit for each
    kAllAxes = kAlongOthers | kEnclosed,
    kInCavity = 64,  // the Enclosure across the column is at least kBehindGap
    kInRing = 128;   // it is kSurrounded

// A cavity with more air than this part of its voxels is an airway or a sinus, not marrow.
constexpr double kMostAir = 0.1;
// A tunnel through bone that is open only at the ends of the scan can be the spinal canal between
// two openings, or a shaft that the scan cuts. It is a shaft if at least half of it is fat (the
// canal also holds nerves and fluid), or if it is so long, with hardly a gap in its wall, that a
// canal would have openings for nerves.
constexpr double kFat_HU = -30;
constexpr double kShaft_mm = 60;
constexpr double kMostGaps = 0.02;  // part of the voxels in planes with a gap in the wall

// The closed cavities across an axis, without those with much air.
struct ClosedCavities {
  Cavities found;
  std::vector<bool> is_closed, is_shaft;  // of each cavity; shafts are closed

  // Calls visit(voxel) for the voxels of the cavities of a list.
  template <typename Visit>
  void each(const std::vector<bool>& of, const Visit& visit) const {
    found.each([&](std::uint32_t c, std::size_t i) {
      if (of[c]) visit(i);
    });
  }
};

// `flags` has packed_hu() if `is_hu`, and kFillable.
ClosedCavities closed_cavities(Cavities found, const VoxelPlanes& planes, bool is_hu,
                               const Bytes& flags) {
  std::vector<std::size_t> air(found.cavities.size(), 0), fat = air;
  found.each([&](std::uint32_t c, std::size_t i) {
    air[c] += (flags[i] & kFillable) == 0 ? 1 : 0;
    fat[c] += is_hu && unpacked_hu(flags[i]) < kFat_HU ? 1 : 0;
  });
  ClosedCavities out;
  const std::vector<double>& at = planes.grid.at_mm[planes.across];
  for (std::size_t c = 0; c < air.size(); ++c) {
    const Cavity& cavity = found.cavities[c];
    const auto all = static_cast<double>(cavity.voxels);
    const bool is_closed = cavity.is_closed && static_cast<double>(air[c]) <= kMostAir * all;
    const bool is_long = at[cavity.last] - at[cavity.first] >= kShaft_mm &&
                         static_cast<double>(cavity.behind_gap) <= kMostGaps * all;
    out.is_closed.push_back(is_closed);
    out.is_shaft.push_back(is_closed && (2 * fat[c] >= cavity.voxels || is_long));
  }
  out.found = std::move(found);
  return out;
}

// The planes in which each voxel is enclosed: CanalFlags and the flags above. In a closed cavity
// across another axis than the column, a voxel counts as enclosed across both of the others; in a
// shaft it is not kWide, so that it is no canal. Nothing outside the material's box is enclosed.
Bytes enclosed_voxels(const VoxelGrid& grid, std::size_t column, bool is_hu,
                      const SolidOptions& options, const Bytes& flags, const Bytes& material) {
  Bytes out(grid.size(), kWide);
  const Box box = box_of(grid, material, std::max(options.close_mm, kCanalDisc_mm) * (1 + 1e-5));
  const std::size_t nx = box.grid.count(0), ny = box.grid.count(1), nz = box.grid.count(2);
  const auto each_row = [&](const auto& visit) {
    for (std::size_t z = 0; z < nz; ++z)
      for (std::size_t y = 0; y < ny; ++y)
        visit(box.row(grid, y, z), (z * ny + y) * nx);
  };
  // Inner: the flags, with kMaterial as `material` has it.
  Bytes inner(box.grid.size()), state(box.grid.size(), 0), enclosure(box.grid.size());
  each_row([&](std::size_t from, std::size_t to) {
    for (std::size_t x = 0; x < nx; ++x)
      inner[to + x] =
          static_cast<std::uint8_t>((flags[from + x] & ~unsigned{kMaterial}) | material[from + x]);
  });
  const auto is_bone = [&inner](std::size_t i) { return (inner[i] & kMaterial) != 0; };
  std::uint8_t bit = 0;
  for (const std::size_t axis : {column, (column + 1) % 3, (column + 2) % 3}) {
    const VoxelPlanes planes(box.grid, axis);
    const PlaneGrid plane_grid = planes.plane();
    parallel_for(static_cast<int>(planes.count()), [&](int plane) {
      thread_local Bytes solid, enclosed;
      thread_local std::vector<float> apart2;
      solid.resize(plane_grid.size());
      const auto here = static_cast<std::size_t>(plane);
      planes.each(here, [&](std::size_t i, std::size_t voxel) { solid[i] = is_bone(voxel); });
      find_enclosed(plane_grid, solid, options.close_mm, *options.fill_mm2, enclosed, kCanalDisc_mm,
                    axis == column ? &apart2 : nullptr);
      planes.each(here, [&](std::size_t i, std::size_t voxel) {
        enclosure[voxel] = enclosed[i];
        if (axis != column) {
          if (enclosed[i] != kNotEnclosed) state[voxel] |= bit;
          return;
        }
        constexpr double kWide_mm2 = kCanalDisc_mm * kCanalDisc_mm;
        state[voxel] |=
            static_cast<std::uint8_t>((enclosed[i] != kNotEnclosed ? kEnclosed : 0) |
                                      (enclosed[i] >= kBehindGap ? kInCavity : 0) |
                                      (enclosed[i] == kSurrounded ? kInRing : 0) |
                                      (double{apart2[i]} > kWide_mm2 * (1 + 1e-6) ? kWide : 0));
      });
    });
    bit = bit == 0 ? 1 : 2;
    if (axis == column) continue;
    const ClosedCavities cavities = closed_cavities(
        find_cavities(planes, box.from[axis] == 0, box.to[axis] == grid.count(axis), is_bone,
                      [&enclosure](std::size_t i) { return enclosure[i]; }),
        planes, is_hu, inner);
    cavities.each(cavities.is_closed, [&](std::size_t i) { state[i] |= kAlongOthers; });
    cavities.each(cavities.is_shaft,
                  [&](std::size_t i) { state[i] &= static_cast<std::uint8_t>(~unsigned{kWide}); });
  }
  each_row([&](std::size_t to, std::size_t from) { std::copy_n(&state[from], nx, &out[to]); });
  return out;
}

struct Filled {
  std::vector<Canal> canals;
  int cut_canals = 0;  // closed cavities that the scan's end cuts and that stay open as canals
  double cut_mm3 = 0;  // their volume
};

// Step 2 of solid_bone.h.
Filled fill(const VoxelGrid& grid, std::size_t column, bool is_hu, const SolidOptions& options,
            const Bytes& flags, Bytes& material) {
  Bytes state = enclosed_voxels(grid, column, is_hu, options, flags, material);
  const VoxelPlanes planes(grid, column);
  const ClosedCavities cavities =
      closed_cavities(find_cavities(
                          planes, true, true, [&](std::size_t i) { return material[i] != 0; },
                          [&](std::size_t i) {
                            const std::uint8_t s = state[i];
                            return (s & kInRing) != 0     ? kSurrounded
                                   : (s & kInCavity) != 0 ? kBehindGap
                                   : (s & kEnclosed) != 0 ? kInCrevice
                                                          : kNotEnclosed;
                          }),
                      planes, is_hu, flags);
  cavities.each(cavities.is_shaft, [&state](std::size_t i) {
    state[i] &= static_cast<std::uint8_t>(~unsigned{kWide});
  });

  Filled out;
  out.canals = find_canals(
      planes, material,
      is_hu ? std::span<const std::uint8_t>(flags) : std::span<const std::uint8_t>(), state);
  std::vector<bool> is_canal(cavities.is_closed.size(), false);
  cavities.found.each([&](std::uint32_t c, std::size_t i) {
    if ((state[i] & kInSection) != 0) is_canal[c] = cavities.is_closed[c];
  });
  cavities.found.each([&](std::uint32_t c, std::size_t i) {
    if (is_canal[c] && cavities.found.cavities[c].is_cut) out.cut_mm3 += grid.mm3(i);
    if (cavities.is_closed[c] && !is_canal[c]) state[i] |= kAllAxes;
  });
  for (std::size_t c = 0; c < is_canal.size(); ++c)
    out.cut_canals += is_canal[c] && cavities.found.cavities[c].is_cut ? 1 : 0;
  for (std::size_t i = 0; i < material.size(); ++i) {
    const bool is_enclosed = std::popcount(static_cast<unsigned>(state[i] & kAllAxes)) >= 2;
    if (is_enclosed && (state[i] & kInCanal) == 0 && (flags[i] & kFillable) != 0) material[i] = 1;
  }
  return out;
}

std::string rounded_text(double value) {
  return std::to_string(std::lround(value));
}

Warning cut_warning(const SliceStack& stack, const Filled& filled) {
  const bool is_one = filled.cut_canals == 1;
  return {"cavity_cut", input_name(stack),
          (is_one ? "a cavity of " : std::to_string(filled.cut_canals) + " cavities of ") +
              rounded_text(filled.cut_mm3) + " mm^3 within bone, cut by the end of the scan, " +
              (is_one ? "stays" : "stay") +
              " open: it cannot be told from a canal; a scan in which it ends, or a longer one, "
              "can"};
}

Warning contrast_warning(const SliceStack& stack, const SoftRegions& soft, bool is_dropped) {
  const std::string hu = rounded_text(soft.low_HU) == rounded_text(soft.high_HU)
                             ? rounded_text(soft.low_HU)
                             : rounded_text(soft.low_HU) + " to " + rounded_text(soft.high_HU);
  return {"contrast_filled", input_name(stack),
          rounded_text(soft.volume_mm3 / 1000) + " ml of soft tissue at " + hu +
              " HU are above the threshold" + (soft.touches_bone ? " and connected to bone" : "") +
              ", such as vessels and organs filled with contrast medium; " +
              (is_dropped ? "--keep column leaves them out"
                          : "--preset column leaves them out, --seed or --mask select bone")};
}

// Drops soft regions, and keeps them from being filled. Voxels in the highest step of packed HU are
// never soft, because this step also stands for the higher values of cortex, calcification and
// metal. So from 556 HU on nothing is dropped, although a region's limit can be as high as 599 HU.
void drop_soft(const VoxelGrid& grid, const BlockMeans& means, const SoftRegions& soft,
               Bytes& flags, Bytes& material) {
  std::size_t voxel = 0;
  for (std::size_t z = 0; z < grid.count(2); ++z) {
    for (std::size_t y = 0; y < grid.count(1); ++y) {
      for (std::size_t x = 0; x < grid.count(0); ++x, ++voxel) {
        const std::uint16_t limit_HU = soft.limit_HU[means.block(x, y, z)];
        if (limit_HU == 0 || is_in_highest_step(flags[voxel]) ||
            unpacked_hu(flags[voxel]) > limit_HU)
          continue;
        material[voxel] = 0;
        flags[voxel] &= static_cast<std::uint8_t>(~kFillable);
      }
    }
  }
}

// Keeps what kColumn_mm describes, around a canal.
void keep_column(const VoxelPlanes& planes, const Canal& canal, Bytes& material) {
  const std::vector<Canal::Section>& path = canal.sections;
  const std::vector<double>& at = planes.grid.at_mm[planes.across];
  Bytes core(material.size(), 0);
  std::size_t next = 0;
  for (std::size_t k = 0; k < planes.count(); ++k) {
    while (next < path.size() && path[next].plane < k)
      ++next;
    const Canal::Section& b = path[std::min(next, path.size() - 1)];
    const Canal::Section& a = next > 0 && next < path.size() && b.plane != k ? path[next - 1] : b;
    const double t = a.plane == b.plane ? 0 : (at[k] - at[a.plane]) / (at[b.plane] - at[a.plane]);
    const double u = a.u_mm + t * (b.u_mm - a.u_mm), v = a.v_mm + t * (b.v_mm - a.v_mm);
    planes.each(k, [&](std::size_t i, std::size_t voxel) {
      if (material[voxel] == 0) return;
      const double du = planes.grid.at_mm[planes.u][i % planes.width()] - u;
      const double dv = planes.grid.at_mm[planes.v][i / planes.width()] - v;
      const double apart = du * du + dv * dv;
      if (apart > kColumn_mm * kColumn_mm) material[voxel] = 0;
      if (apart <= kColumnCore_mm * kColumnCore_mm) core[voxel] = 1;
    });
  }
  const VoxelComponents components = find_components(planes.grid, material);
  std::vector<bool> stays(components.volume_mm3.size(), false);
  for (const VoxelComponents::Run& run : components.runs)
    for (std::size_t i = run.begin; i < run.end; ++i)
      if (core[i] != 0) stays[run.component] = true;
  keep_components(
      components, [&](std::uint32_t c) { return stays[c]; }, material);
}

// Step 3. A voxel stays if its centre is within the margin of the centre of a wanted voxel.
Result<void> keep_near_mask(const SliceStack& stack, const VoxelGrid& grid,
                            std::optional<SliceAxis> axis, const SolidOptions& options,
                            Bytes& material, std::vector<Warning>& warnings) {
  OpenOptions open;
  open.axis = axis;
  open.as_labels = true;
  const auto mask = open_volume(options.mask_file, open);
  if (!mask) return mask.error();
  if (const auto differs = grid_difference(**mask, stack)) {
    return refused((differs->slice < 0 ? options.mask_file : (*mask)->name(differs->slice)) +
                   ": its " + differs->what + "; --mask needs a label map on the scan's grid");
  }
  ValueTally tally;
  for (int k = 0; k < (*mask)->size(); ++k) {
    const auto image = (*mask)->read_labels(k);
    if (!image) {
      Error error = image.error();
      const std::size_t advice = error.message.rfind("; if this is no label map");
      if (advice != std::string::npos)  // what to do with --labels
        error.message.replace(advice, std::string::npos, "; --mask needs a label map");
      return error;
    }
    tally.add(tally_values(*image));
  }
  const Labels labels{options.mask_labels};
  if (const auto doubt = value_warning(tally, (*mask)->pixel_unit(), labels, options.mask_file))
    return refused(doubt->where + ": " + doubt->sentence.substr(0, doubt->sentence.find(';')) +
                   "; --mask needs a label map");
  if (auto rounded = rounding_warning(tally, options.mask_file))
    warnings.push_back(std::move(*rounded));
  const auto flags = segmented(**mask, labels, grid);
  if (!flags) return flags.error();
  const Bytes near = material_of(*flags);
  if (!holds_any(near))
    return refused(options.mask_file + ": holds none of the labels wanted of --mask");
  keep_near(grid, near, kMaskMargin_mm, material);
  return {};
}

std::string point_text(const Eigen::Vector3d& p) {
  char out[96];
  std::snprintf(out, sizeof out, "%g,%g,%g", p.x(), p.y(), p.z());
  return out;
}

// The voxel of material nearest to each seed.
Result<std::vector<std::size_t>> seed_voxels(const SliceStack& stack, const VoxelGrid& grid,
                                             const SolidOptions& options, const Bytes& material) {
  std::vector<std::size_t> out;
  const std::size_t width = grid.count(0), pixels = width * grid.count(1);
  for (const Eigen::Vector3d& seed : options.seeds_lps_mm) {
    double min_squared = kMaxSeedDistance_mm * kMaxSeedDistance_mm;
    std::optional<std::size_t> nearest;
    for (int k = 0; k < stack.size(); ++k) {
      const SlicePlane& plane = stack.plane(k);
      const Eigen::Vector3d at = plane.T_lps_plane.inverse() * seed;
      if (at.z() * at.z() > min_squared) continue;
      for (std::size_t i = 0; i < pixels; ++i) {
        const std::size_t voxel = static_cast<std::size_t>(k) * pixels + i;
        if (material[voxel] == 0) continue;
        const std::size_t x = i % width, y = i / width;
        const Eigen::Vector3d apart =
            at - Eigen::Vector3d(static_cast<double>(x) * plane.spacing_u_mm,
                                 static_cast<double>(y) * plane.spacing_v_mm, 0);
        if (apart.squaredNorm() > min_squared || (nearest && apart.squaredNorm() == min_squared))
          continue;
        min_squared = apart.squaredNorm();
        nearest = voxel;
      }
    }
    if (!nearest) {
      return refused("--seed " + point_text(seed) + ": no material within " +
                     std::to_string(static_cast<int>(kMaxSeedDistance_mm)) +
                     " mm; seeds are patient coordinates (left, back, up) in mm");
    }
    out.push_back(*nearest);
  }
  return out;
}

double volume_mm3(const VoxelGrid& grid, const Bytes& voxels) {
  const std::vector<double> volumes = find_components(grid, voxels).volume_mm3;
  return std::accumulate(volumes.begin(), volumes.end(), 0.0);
}

// The error if nothing is left of the material. It names all options that can have removed it.
Error nothing_left_error(const SolidOptions& options, double before_mm3) {
  std::vector<const char*> names;
  if (options.min_volume_mm3 > 0) names.push_back("--min-volume");
  if (options.column) names.push_back("--keep column");
  if (!options.mask_file.empty()) names.push_back("--mask");
  std::string out;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const char* const before = i == 0 ? "" : i + 1 < names.size() ? ", " : " and ";
    out.append(before).append(names[i]);
  }
  return refused(out + (names.size() > 1 ? " leave" : " leaves") + " none of the " +
                 rounded_text(before_mm3) + " mm^3 of material");
}

Bytes difference(const Bytes& of, const Bytes& without) {
  Bytes out(of.size());
  for (std::size_t i = 0; i < of.size(); ++i)
    out[i] = of[i] != 0 && without[i] == 0 ? 1 : 0;
  return out;
}

template <typename AnyImage>
AnyImage cropped(AnyImage image, const Crop& c) {
  const int width = c.x1 - c.x0 + 1, height = c.y1 - c.y0 + 1;
  decltype(image.values) values;
  values.reserve(static_cast<std::size_t>(width) * height);
  for (int y = c.y0; y <= c.y1; ++y) {
    const auto row = image.values.begin() + static_cast<std::ptrdiff_t>(y) * image.width;
    values.insert(values.end(), row + c.x0, row + c.x1 + 1);
  }
  image.width = width;
  image.height = height;
  image.values = std::move(values);
  return image;
}

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

Error fill_of_several_error() {
  return usage("--fill fills one material: join the labels with +, as --labels 20+21");
}

Result<SolidBone> SolidBone::make(const SliceStack& stack, const Segmentation& segmentation,
                                  std::optional<SliceAxis> axis, const SolidOptions& options,
                                  const ScannerTable* table) {
  if (auto ok = check_parallel(stack, 0, stack.size() - 1,
                               "without --close, --fill, --min-volume, --largest, --seed and "
                               "--mask each slice is meshed for itself");
      !ok)
    return ok.error();
  const VoxelGrid grid = grid_of(stack);
  const bool is_hu = has_hu(stack, segmentation);
  std::optional<BlockMeans> means;
  if (needs_soft_regions(stack, segmentation, options)) means.emplace(grid);
  std::set<int> labels;
  auto flags = segmented(stack, segmentation, grid, means ? &*means : nullptr, &labels);
  if (!flags) return flags.error();
  const auto* wanted = std::get_if<Labels>(&segmentation);
  const bool fills_all = options.fill_mm2 && wanted != nullptr && wanted->all;
  if (fills_all && labels.size() > 1) return fill_of_several_error();
  Bytes material = material_of(*flags);
  if (table != nullptr) {
    for (const ScannerTable::Run& run : table->runs())
      std::fill_n(&material[run.begin], run.end - run.begin, std::uint8_t{0});
  }
  const Bytes before = material;
  const auto is_emptied = [&] { return holds_any(before) && !holds_any(material); };
  SolidBone out;
  if (fills_all && !labels.empty()) out.filled_label_ = *labels.begin();

  const auto drop_specks = [&] {
    if (!(options.min_volume_mm3 > 0)) return;
    const VoxelComponents components = find_components(grid, material);
    const std::vector<double>& volume = components.volume_mm3;
    keep_components(
        components, [&](std::uint32_t c) { return volume[c] >= options.min_volume_mm3; }, material);
  };
  drop_specks();
  if (means) {
    means->finish();
    const SoftRegions soft = find_soft_regions(*means, std::get<Threshold>(segmentation).value);
    if (soft.count > 0) {
      out.warnings_.push_back(contrast_warning(stack, soft, options.column));
      if (options.column) {
        drop_soft(grid, *means, soft, *flags, material);
        drop_specks();
      }
    }
    means.reset();
  }
  if (options.fill_mm2) {
    const std::size_t column = column_axis(stack);
    const Filled filled = fill(grid, column, is_hu, options, *flags, material);
    const std::vector<Canal>& canals = filled.canals;
    if (filled.cut_canals > 0) out.warnings_.push_back(cut_warning(stack, filled));
    if (options.column && canals.empty() && !is_emptied())
      return refused(
          input_name(stack) +
          ": no spinal canal found, a soft tunnel in a ring of bone; --keep column needs "
          "one, --seed and --mask do not");
    if (options.column && !canals.empty())
      keep_column(VoxelPlanes(grid, column), canals.front(), material);
  }
  *flags = {};
  if (!options.mask_file.empty()) {
    if (auto ok = keep_near_mask(stack, grid, axis, options, material, out.warnings_); !ok)
      return ok.error();
  }
  if (!options.seeds_lps_mm.empty()) {
    const auto seeds = seed_voxels(stack, grid, options, material);
    if (!seeds) return seeds.error();
    keep_nearest_to_first(grid, *seeds, material);
  }
  if (options.largest > 0) keep_largest(grid, material, options.largest);
  if (is_emptied()) return nothing_left_error(options, volume_mm3(grid, before));

  out.width_ = stack.width();
  out.height_ = stack.height();
  out.filled_mm3_ = volume_mm3(grid, difference(material, before));
  out.dropped_mm3_ = volume_mm3(grid, difference(before, material));
  out.material_ = std::move(material);
  return out;
}

std::optional<double> SolidBone::apply(int slice, int offset_x, int offset_y, Field& field) const {
  const Image& image = field.image;
  double sum = 0;
  std::size_t count = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const std::size_t pixel = static_cast<std::size_t>(y) * image.width + x;
      const float value = image.values[pixel];
      const bool wanted = inside(slice, x + offset_x, y + offset_y);
      if (wanted) {
        sum += static_cast<double>(value);
        ++count;
      }
      if ((value >= field.iso) != wanted) put_on_side(field, pixel, wanted);
    }
  }
  if (count == 0) return std::nullopt;
  return sum / static_cast<double>(count);
}

Result<Image> read_cropped(const SliceStack& stack, int slice, const std::optional<Crop>& crop) {
  auto image = stack.read(slice);
  if (image && crop) return cropped(std::move(*image), *crop);
  return image;
}

Result<Pixels> read_cropped(const SliceStack& stack, int slice, const MaterialOptions& options) {
  auto pixels = read_pixels(stack, slice, options.segmentation);
  if (!pixels || !options.crop) return pixels;
  return std::visit([&](auto& image) { return Pixels(cropped(std::move(image), *options.crop)); },
                    *pixels);
}

SliceField slice_field(const SliceStack& stack, int slice, const MaterialOptions& options,
                       Pixels pixels) {
  SliceField out{segment(std::move(pixels), stack.pixel_unit(), options.segmentation), {}};
  const Crop crop = options.crop.value_or(Crop{});
  if (options.table != nullptr) options.table->remove(slice, crop.x0, crop.y0, out.field);
  if (options.solid == nullptr) return out;
  out.solid_mean = options.solid->apply(slice, crop.x0, crop.y0, out.field);
  return out;
}

}  // namespace trocar::pipeline
