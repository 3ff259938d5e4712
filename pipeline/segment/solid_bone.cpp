// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/segment/solid_bone.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <queue>
#include <utility>

#include "pipeline/base/parallel_for.h"
#include "pipeline/read/nifti/nifti_stack.h"
#include "pipeline/read/same_grid.h"
#include "pipeline/read/stack_shape.h"
#include "pipeline/segment/connected_components.h"
#include "pipeline/segment/label_map_detection.h"
#include "pipeline/segment/nearest_seed.h"
#include "pipeline/segment/plane_flood.h"

namespace trocar::pipeline {
namespace {

using Bytes = std::vector<std::uint8_t>;

enum VoxelFlag : std::uint8_t { kMaterial = 1, kFillable = 2 };

Result<VoxelGrid> grid_of(const SliceStack& stack) {
  if (auto ok = check_parallel(stack, 0, stack.size() - 1,
                               "without --close, --fill, --min-volume, --largest, --seed and "
                               "--mask each slice is meshed for itself");
      !ok)
    return ok.error();
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

// Calls work(slice) -> Result<void> for every slice, several at once. Returns the lowest slice's
// error.
template <typename Work>
Result<void> for_each_slice(int slices, const Work& work) {
  std::vector<Result<void>> done(static_cast<std::size_t>(slices));
  parallel_for(slices, [&](int k) { done[static_cast<std::size_t>(k)] = work(k); });
  for (Result<void>& one : done)
    if (!one) return one;
  return {};
}

// The VoxelFlags of each voxel, one byte each.
Result<Bytes> segmented(const SliceStack& stack, const Segmentation& how, const VoxelGrid& grid) {
  const std::size_t pixels = grid.count(0) * grid.count(1);
  Bytes out(grid.size());
  const bool is_hu =
      stack.pixel_unit() == PixelUnit::kHounsfield && std::holds_alternative<Threshold>(how);
  const auto ok = for_each_slice(stack.size(), [&](int k) -> Result<void> {
    auto image = stack.read(k);
    if (!image) return image.error();
    const Field field = segment(std::move(*image), stack.pixel_unit(), how);
    std::uint8_t* flags = &out[static_cast<std::size_t>(k) * pixels];
    for (std::size_t i = 0; i < pixels; ++i) {
      const float value = field.image.values[i];
      flags[i] = static_cast<std::uint8_t>((value >= field.iso ? kMaterial : 0) |
                                           (!is_hu || value >= kAir_HU ? kFillable : 0));
    }
    return {};
  });
  if (!ok) return ok.error();
  return out;
}

// Keeps the material of the components for which keep(component, volume_mm3) holds.
template <typename Keep>
void keep_components(const VoxelGrid& grid, Bytes& material, const Keep& keep) {
  const VoxelComponents components = find_components(grid, material);
  for (const VoxelComponents::Run& run : components.runs) {
    if (keep(run.component, components.volume_mm3[run.component])) continue;
    std::fill(material.begin() + static_cast<std::ptrdiff_t>(run.begin),
              material.begin() + static_cast<std::ptrdiff_t>(run.end), std::uint8_t{0});
  }
}

void keep_largest(const VoxelGrid& grid, Bytes& material, int wanted) {
  const std::vector<double> volume = find_components(grid, material).volume_mm3;
  std::vector<std::uint32_t> order(volume.size());
  std::iota(order.begin(), order.end(), 0U);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return volume[a] > volume[b]; });
  std::vector<bool> stays(volume.size(), false);
  for (std::size_t i = 0; i < order.size() && i < static_cast<std::size_t>(wanted); ++i)
    stays[order[i]] = true;
  keep_components(grid, material,
                  [&](std::uint32_t component, double) { return stays[component]; });
}

// The planes across one axis of a volume, read and written as images.
struct Planes {
  const VoxelGrid& grid;
  std::size_t across, u, v;  // axes
  std::size_t stride(std::size_t axis) const {
    return axis == 0 ? 1 : axis == 1 ? grid.count(0) : grid.count(0) * grid.count(1);
  }
  template <typename Visit>  // visit(index in the plane, index in the volume)
  void each(std::size_t plane, const Visit& visit) const {
    std::size_t i = 0;
    for (std::size_t y = 0; y < grid.count(v); ++y) {
      std::size_t voxel = plane * stride(across) + y * stride(v);
      for (std::size_t x = 0; x < grid.count(u); ++x, voxel += stride(u))
        visit(i++, voxel);
    }
  }
};

// Step 2 of solid_bone.h.
void fill(const VoxelGrid& grid, const SolidOptions& options, const Bytes& flags, Bytes& material) {
  Bytes times(grid.size(), 0);  // number of directions in which the voxel is enclosed
  const std::array<Planes, 3> directions{Planes{grid, 2, 0, 1}, Planes{grid, 1, 0, 2},
                                         Planes{grid, 0, 1, 2}};
  for (const Planes& planes : directions) {
    const PlaneGrid plane_grid{grid.at_mm[planes.u], grid.at_mm[planes.v]};
    parallel_for(static_cast<int>(grid.count(planes.across)), [&](int plane) {
      thread_local Bytes solid, enclosed;
      solid.resize(plane_grid.size());
      const auto here = static_cast<std::size_t>(plane);
      planes.each(here, [&](std::size_t i, std::size_t voxel) { solid[i] = material[voxel]; });
      find_enclosed(plane_grid, solid, options.close_mm, *options.fill_mm2, enclosed);
      planes.each(here, [&](std::size_t i, std::size_t voxel) { times[voxel] += enclosed[i]; });
    });
  }
  for (std::size_t i = 0; i < material.size(); ++i)
    if (times[i] >= 2 && (flags[i] & kFillable) != 0) material[i] = 1;
}

// Step 3. A voxel stays if its centre is within the margin of the centre of a wanted voxel.
Result<void> keep_near_mask(const SliceStack& stack, const VoxelGrid& grid,
                            std::optional<SliceAxis> axis, const SolidOptions& options,
                            Bytes& material) {
  OpenOptions open;
  open.axis = axis;
  open.as_labels = true;
  const auto mask = open_nifti(options.mask_file, open);
  if (!mask) return mask.error();
  if (const auto differs = grid_difference(**mask, stack)) {
    return refused((differs->slice < 0 ? options.mask_file : (*mask)->name(differs->slice)) +
                   ": its " + differs->what + "; --mask needs a label map on the scan's grid");
  }
  ValueTally tally;
  for (int k = 0; k < (*mask)->size(); ++k) {
    const auto image = (*mask)->read(k);
    if (!image) return image.error();
    tally.add(tally_values(*image, true));
  }
  const Labels labels{options.mask_labels};
  if (const auto doubt = value_warning(tally, (*mask)->pixel_unit(), labels, options.mask_file))
    return refused(doubt->where + ": " + doubt->sentence.substr(0, doubt->sentence.find(';')) +
                   "; --mask needs a label map");
  const auto flags = segmented(**mask, labels, grid);
  if (!flags) return flags.error();
  Bytes near(grid.size());
  std::transform(flags->begin(), flags->end(), near.begin(), [](std::uint8_t f) {
    return static_cast<std::uint8_t>((f & kMaterial) != 0 ? 1 : 0);
  });
  if (std::find(near.begin(), near.end(), 1) == near.end())
    return refused(options.mask_file + ": holds none of the labels wanted of --mask");
  keep_near(grid, near, kMaskMargin_mm, material);
  return {};
}

std::string text_of(const Eigen::Vector3d& p) {
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
      return refused("--seed " + text_of(seed) + ": no material within " +
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

Bytes difference(const Bytes& of, const Bytes& without) {
  Bytes out(of.size());
  for (std::size_t i = 0; i < of.size(); ++i)
    out[i] = of[i] != 0 && without[i] == 0 ? 1 : 0;
  return out;
}

}  // namespace

Result<SolidBone> SolidBone::make(const SliceStack& stack, const Segmentation& segmentation,
                                  std::optional<SliceAxis> axis, const SolidOptions& options) {
  const auto grid = grid_of(stack);
  if (!grid) return grid.error();
  auto flags = segmented(stack, segmentation, *grid);
  if (!flags) return flags.error();
  Bytes material(grid->size());
  std::transform(flags->begin(), flags->end(), material.begin(), [](std::uint8_t f) {
    return static_cast<std::uint8_t>((f & kMaterial) != 0 ? 1 : 0);
  });
  const Bytes before = material;

  if (options.min_volume_mm3 > 0) {
    keep_components(*grid, material,
                    [&](std::uint32_t, double mm3) { return mm3 >= options.min_volume_mm3; });
  }
  if (options.fill_mm2) fill(*grid, options, *flags, material);
  *flags = {};
  if (!options.mask_file.empty()) {
    if (auto ok = keep_near_mask(stack, *grid, axis, options, material); !ok) return ok.error();
  }
  if (!options.seeds_lps_mm.empty()) {
    const auto seeds = seed_voxels(stack, *grid, options, material);
    if (!seeds) return seeds.error();
    keep_nearest_to_first(*grid, *seeds, material);
  }
  if (options.largest > 0) keep_largest(*grid, material, options.largest);

  const auto holds_any = [](const Bytes& voxels) {
    return std::find(voxels.begin(), voxels.end(), 1) != voxels.end();
  };
  if (holds_any(before) && !holds_any(material))
    return refused(std::string(options.mask_file.empty()    ? "--min-volume leaves"
                               : options.min_volume_mm3 > 0 ? "--min-volume and --mask leave"
                                                            : "--mask leaves") +
                   " none of the " + std::to_string(std::lround(volume_mm3(*grid, before))) +
                   " mm^3 of material");

  SolidBone out;
  out.width_ = stack.width();
  out.height_ = stack.height();
  out.filled_mm3_ = volume_mm3(*grid, difference(material, before));
  out.dropped_mm3_ = volume_mm3(*grid, difference(before, material));
  out.material_ = std::move(material);
  return out;
}

std::optional<double> SolidBone::apply(int slice, int offset_x, int offset_y, Field& field) const {
  Image& image = field.image;
  double sum = 0;
  std::size_t count = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      float& value = image.values[static_cast<std::size_t>(y) * image.width + x];
      const bool wanted = inside(slice, x + offset_x, y + offset_y);
      if (wanted) {
        sum += static_cast<double>(value);
        ++count;
      }
      if ((value >= field.iso) == wanted) continue;
      const float mirrored = 2 * field.iso - value;
      // A value equal to the iso-value, or to it after rounding, moves by the smallest step.
      const float nearest = std::nextafter(field.iso, -std::numeric_limits<float>::infinity());
      value = wanted ? std::max(mirrored, field.iso) : std::min(mirrored, nearest);
    }
  }
  if (count == 0) return std::nullopt;
  return sum / static_cast<double>(count);
}

}  // namespace trocar::pipeline
