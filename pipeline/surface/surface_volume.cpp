// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/surface/surface_volume.h"

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "pipeline/read/parallel_for.h"

namespace trocar::pipeline {
namespace {

// A value outside, as far from zero as the given one. Zero itself would be in the material.
float outside(float value) {
  return -std::max(std::abs(value), std::numeric_limits<float>::min());
}

void drop_small(SurfaceVolume& volume, bool inside, std::int64_t min_voxels) {
  std::vector<std::uint8_t> side(volume.values.size());
  std::transform(volume.values.begin(), volume.values.end(), side.begin(), [inside](float v) {
    return static_cast<std::uint8_t>((v >= 0) == inside ? 1 : 0);
  });
  std::array<std::size_t, 3> size{};
  std::copy(volume.size.begin(), volume.size.end(), size.begin());
  const VoxelRuns found = find_runs(size, side, false);
  std::vector<std::int64_t> voxels(found.components, 0);
  for (const VoxelRuns::Run& run : found.runs)
    voxels[run.component] += static_cast<std::int64_t>(run.end - run.begin);
  const auto [u, v, w] = volume.voxel_mm();
  for (const std::int64_t count : voxels) {
    if (count >= min_voxels) continue;
    ++(inside ? volume.dropped.specks : volume.dropped.holes);
    volume.dropped.largest_mm3 =
        std::max(volume.dropped.largest_mm3, static_cast<double>(count) * u * v * w);
  }
  for (const VoxelRuns::Run& run : found.runs) {
    if (voxels[run.component] >= min_voxels) continue;
    for (std::size_t i = run.begin; i < run.end; ++i)
      volume.values[i] = inside ? outside(volume.values[i]) : -volume.values[i];
  }
}

// Adds a border one voxel wide, as far below zero as its neighbour is away from zero.
SurfaceVolume with_border(SurfaceVolume inner) {
  SurfaceVolume out;
  out.u_mm = inner.u_mm;
  out.v_mm = inner.v_mm;
  out.T_lps_volume = inner.T_lps_volume;
  for (std::size_t k = 0; k < 3; ++k)
    out.size[k] = inner.size[k] + 2;
  out.values.resize(static_cast<std::size_t>(out.size[0]) * out.size[1] * out.size[2]);
  const int width = inner.size[0];
  float* to = out.values.data();
  for (int z = -1; z <= inner.size[2]; ++z) {
    for (int y = -1; y <= inner.size[1]; ++y) {
      const int cy = std::clamp(y, 0, inner.size[1] - 1), cz = std::clamp(z, 0, inner.size[2] - 1);
      const float* row = &inner.values[(static_cast<std::size_t>(cz) * inner.size[1] + cy) * width];
      *to++ = outside(row[0]);
      if (cy == y && cz == z)
        to = std::copy_n(row, width, to);
      else
        to = std::transform(row, row + width, to, outside);
      *to++ = outside(row[width - 1]);
    }
  }
  std::vector<Eigen::Vector3d>& o = inner.origin_mm;
  const Eigen::Vector3d corner(inner.u_mm, inner.v_mm, 0);
  out.origin_mm.push_back(2 * o[0] - o[1] - corner);
  for (const Eigen::Vector3d& p : o)
    out.origin_mm.emplace_back(p - corner);
  out.origin_mm.emplace_back(2 * o[o.size() - 1] - o[o.size() - 2] - corner);
  return out;
}

// Applies a Gaussian of one voxel along each axis. A voxel stays on its side of zero, with at least
// kMin of half the step between the sides.
void smooth_mask(SurfaceVolume& volume) {
  constexpr double kSigma = 1;
  constexpr float kMin = 0.05F;
  const std::size_t row = static_cast<std::size_t>(volume.size[0]), slice = row * volume.size[1];
  const std::vector<float> mask = volume.values;
  parallel_for(volume.size[2], [&](int z) {
    cv::Mat image(volume.size[1], volume.size[0], CV_32F,
                  &volume.values[static_cast<std::size_t>(z) * slice]);
    cv::GaussianBlur(image, image, cv::Size(7, 7), kSigma, kSigma, cv::BORDER_REPLICATE);
  });
  // Along z, the voxels of the same y form an image that is smoothed along its columns.
  parallel_for(volume.size[1], [&](int y) {
    cv::Mat image(volume.size[2], volume.size[0], CV_32F);
    const auto at = [&](int z) {
      return volume.values.begin() +
             static_cast<std::ptrdiff_t>(static_cast<std::size_t>(z) * slice +
                                         static_cast<std::size_t>(y) * row);
    };
    for (int z = 0; z < volume.size[2]; ++z)
      std::copy_n(at(z), row, image.ptr<float>(z));
    cv::GaussianBlur(image, image, cv::Size(1, 7), kSigma, kSigma, cv::BORDER_REPLICATE);
    for (int z = 0; z < volume.size[2]; ++z)
      std::copy_n(image.ptr<float>(z), row, at(z));
  });
  for (std::size_t i = 0; i < mask.size(); ++i) {
    float& value = volume.values[i];
    value = mask[i] >= 0 ? std::max(value, kMin) : std::min(value, -kMin);
  }
}

// The voxels of a block: along each axis from a first one to before the last.
struct VoxelBlock {
  std::array<int, 3> from{}, to{};
  int voxels() const { return (to[0] - from[0]) * (to[1] - from[1]) * (to[2] - from[2]); }
};

// Calls visit(value) for each voxel of a block.
template <typename Visit>
void each_value(const SurfaceVolume& volume, const VoxelBlock& block, const Visit& visit) {
  for (int z = block.from[2]; z < block.to[2]; ++z)
    for (int y = block.from[1]; y < block.to[1]; ++y)
      for (int x = block.from[0]; x < block.to[0]; ++x)
        visit(volume.value(x, y, z));
}

struct BlockMean {
  float value = 0;
  // Value of the border beside the block, along x and along y. 0: as with_border() makes it.
  std::array<float, 2> border{};
};

// The mean of block (x, y, z). The last block of a row or column can be partial. If material
// reaches its end, the voxels that it lacks count as well: each is as far below zero as the last
// voxel of its row or column is away from zero. Otherwise the surface would lie up to a block
// beyond the end of the scan, because the mean's place is the middle of a full block.
BlockMean block_mean(const SurfaceVolume& volume, const std::array<int, 3>& factor,
                     const std::array<int, 3>& at) {
  VoxelBlock block;
  for (std::size_t k = 0; k < 3; ++k) {
    block.from[k] = 1 + at[k] * factor[k];
    block.to[k] = std::min(block.from[k] + factor[k], volume.size[k] - 1);
  }
  BlockMean out;
  VoxelBlock full = block;
  for (std::size_t axis = 0; axis < 2; ++axis) {
    if (block.to[axis] - block.from[axis] == factor[axis]) continue;
    VoxelBlock end = block;
    end.from[axis] = end.to[axis] - 1;
    double sum = 0;
    bool is_cut = false;
    each_value(volume, end, [&](float value) {
      sum += static_cast<double>(outside(value));
      is_cut = is_cut || value >= 0;
    });
    if (!is_cut) continue;
    full.to[axis] = full.from[axis] + factor[axis];
    out.border[axis] = static_cast<float>(sum / end.voxels());
  }
  double sum = 0;
  each_value(volume, block, [&sum](float value) { sum += static_cast<double>(value); });
  if (full.to != block.to) {
    for (int z = full.from[2]; z < full.to[2]; ++z) {
      for (int y = full.from[1]; y < full.to[1]; ++y) {
        for (int x = y < block.to[1] ? block.to[0] : full.from[0]; x < full.to[0]; ++x) {
          const float last =
              volume.value(std::min(x, block.to[0] - 1), std::min(y, block.to[1] - 1), z);
          sum += static_cast<double>(outside(last));
        }
      }
    }
  }
  out.value = static_cast<float>(sum / full.voxels());
  return out;
}

// The volume with its border, smoothed if it is a mask, without small components.
SurfaceVolume finished(SurfaceVolume inner, bool is_mask, double min_region_mm2) {
  if (is_mask) smooth_mask(inner);
  SurfaceVolume out = with_border(std::move(inner));
  drop_small_components(out, kMinSurfaceVoxels, std::pow(min_region_mm2, 1.5));
  if (std::none_of(out.values.begin(), out.values.end(), [](float v) { return v >= 0; })) {
    SurfaceVolume none;
    none.dropped = out.dropped;
    return none;
  }
  return out;
}

}  // namespace

void drop_small_components(SurfaceVolume& volume, int min_voxels, double min_mm3) {
  const auto [u, v, w] = volume.voxel_mm();
  const auto least = std::max<std::int64_t>(
      min_voxels, static_cast<std::int64_t>(std::ceil(std::min(min_mm3 / (u * v * w), 1e15))));
  for (const bool inside : {true, false})
    drop_small(volume, inside, least);
}

SurfaceVolume coarser(const SurfaceVolume& volume, const std::array<int, 3>& factor) {
  const int fx = factor[0], fy = factor[1], fz = factor[2];
  SurfaceVolume out;
  out.u_mm = volume.u_mm * fx;
  out.v_mm = volume.v_mm * fy;
  out.T_lps_volume = volume.T_lps_volume;
  for (std::size_t k = 0; k < 3; ++k)  // without the border
    out.size[k] = std::max(1, (volume.size[k] - 2 + factor[k] - 1) / factor[k]);
  if (out.size[2] < 2) return volume;
  const auto nx = static_cast<std::size_t>(out.size[0]), ny = static_cast<std::size_t>(out.size[1]),
             nz = static_cast<std::size_t>(out.size[2]);
  out.values.resize(nx * ny * nz);
  for (int z = 0; z < out.size[2]; ++z) {
    const int z0 = 1 + z * fz, z1 = std::min(z0 + fz, volume.size[2] - 1);
    Eigen::Vector3d origin = Eigen::Vector3d::Zero();
    for (int k = z0; k < z1; ++k)
      origin += volume.position(1, 1, k) / (z1 - z0);
    out.origin_mm.emplace_back(
        origin + Eigen::Vector3d((fx - 1) * 0.5 * volume.u_mm, (fy - 1) * 0.5 * volume.v_mm, 0));
  }
  std::vector<float> right(ny * nz), lower(nx * nz);  // BlockMean::border of the last blocks
  parallel_for(out.size[2], [&](int z) {
    const auto slice = static_cast<std::size_t>(z);
    std::size_t i = slice * nx * ny;
    for (int y = 0; y < out.size[1]; ++y) {
      for (int x = 0; x < out.size[0]; ++x) {
        const BlockMean mean = block_mean(volume, factor, {x, y, z});
        out.values[i++] = mean.value;
        if (x == out.size[0] - 1) right[slice * ny + static_cast<std::size_t>(y)] = mean.border[0];
        if (y == out.size[1] - 1) lower[slice * nx + static_cast<std::size_t>(x)] = mean.border[1];
      }
    }
  });
  SurfaceVolume bordered = with_border(std::move(out));
  const std::size_t row = nx + 2, layer = row * (ny + 2);
  for (std::size_t z = 0; z < nz; ++z) {
    for (std::size_t y = 0; y < ny; ++y)
      if (right[z * ny + y] < 0)
        bordered.values[(z + 1) * layer + (y + 2) * row - 1] = right[z * ny + y];
    for (std::size_t x = 0; x < nx; ++x)
      if (lower[z * nx + x] < 0)
        bordered.values[(z + 1) * layer + (ny + 1) * row + x + 1] = lower[z * nx + x];
  }
  return bordered;
}

Result<SurfaceVolume> read_surface_volume(const SliceStack& stack, int first, int last,
                                          const MaterialOptions& options, bool is_one_of_several) {
  constexpr double kMaxVoxels = 2e9;
  if (last == first) return refused(stack.name(first) + ": --surface needs two slices at least");
  if (auto ok = check_parallel(stack, first, last, "mesh it without --surface"); !ok)
    return ok.error();
  const Crop whole{0, stack.width() - 1, 0, stack.height() - 1};
  const Crop& crop = options.crop ? *options.crop : whole;
  const int width = crop.x1 - crop.x0 + 1, height = crop.y1 - crop.y0 + 1,
            slices = last - first + 1;
  if (static_cast<double>(width) * height * slices > kMaxVoxels)
    return refused(stack.name(first) +
                   ": the scan has more voxels than --surface can hold; give "
                   "--slices or --crop");

  std::vector<std::vector<float>> fields(static_cast<std::size_t>(slices));
  std::vector<Eigen::AlignedBox2i> boxes(static_cast<std::size_t>(slices));  // of the material
  bool is_mask = false;
  const auto done = try_in_parallel(slices, [&](int k) -> Result<void> {
    const auto here = static_cast<std::size_t>(k);
    auto pixels = read_cropped(stack, first + k, options);
    if (!pixels) return pixels.error();
    Field field = segment(std::move(*pixels), stack.pixel_unit(), options.segmentation);
    if (options.table != nullptr) options.table->remove(first + k, crop.x0, crop.y0, field);
    if (options.solid != nullptr) {
      const std::vector<float> own = is_one_of_several ? field.image.values : std::vector<float>();
      options.solid->apply(first + k, crop.x0, crop.y0, field);
      for (std::size_t i = 0; i < own.size(); ++i)
        field.image.values[i] = std::min(field.image.values[i], own[i]);
    }
    if (k == 0) is_mask = field.is_mask;
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        float& value = field.image.values[static_cast<std::size_t>(y) * width + x];
        value -= field.iso;
        if (field.is_mask) value *= 2;
        if (!(value < 0)) boxes[here].extend(Eigen::Vector2i(x, y));
      }
    }
    fields[here] = std::move(field.image.values);
    return {};
  });
  if (!done) return done.error();

  // The box around the material, with a margin for smoothing.
  constexpr int kMargin = 4;
  Eigen::AlignedBox3i box;
  for (int k = 0; k < slices; ++k) {
    const Eigen::AlignedBox2i& one = boxes[static_cast<std::size_t>(k)];
    if (one.isEmpty()) continue;
    for (const Eigen::Vector2i& corner : {one.min(), one.max()})
      box.extend(Eigen::Vector3i(corner.x(), corner.y(), k));
  }
  if (box.isEmpty()) return SurfaceVolume{};
  const Eigen::Array3i end(width, height, slices),
      low = (box.min().array() - kMargin).max(0), high = (box.max().array() + kMargin).min(end - 1);

  SurfaceVolume inner;
  const SlicePlane& frame = stack.plane(first);
  inner.u_mm = frame.spacing_u_mm;
  inner.v_mm = frame.spacing_v_mm;
  inner.T_lps_volume = frame.T_lps_plane;
  inner.size = {high.x() - low.x() + 1, high.y() - low.y() + 1, high.z() - low.z() + 1};
  const Eigen::Affine3d to_frame = frame.T_lps_plane.inverse();
  inner.values.reserve(static_cast<std::size_t>(inner.size[0]) * inner.size[1] * inner.size[2]);
  const Eigen::Vector3d corner((crop.x0 + low.x()) * inner.u_mm, (crop.y0 + low.y()) * inner.v_mm,
                               0);
  for (int k = low.z(); k <= high.z(); ++k) {
    inner.origin_mm.emplace_back(to_frame * (stack.plane(first + k).T_lps_plane * corner));
    const std::vector<float>& field = fields[static_cast<std::size_t>(k)];
    for (int y = low.y(); y <= high.y(); ++y) {
      const auto row = field.begin() + static_cast<std::ptrdiff_t>(y) * width;
      inner.values.insert(inner.values.end(), row + low.x(), row + high.x() + 1);
    }
    fields[static_cast<std::size_t>(k)] = {};
  }
  return finished(std::move(inner), is_mask, options.min_region_mm2);
}

}  // namespace trocar::pipeline
