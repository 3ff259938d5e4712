// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/scan/hu_context.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "formats/asset/hu_codec.h"
#include "pipeline/base/parallel_for.h"
#include "pipeline/read/stack_shape.h"
#include "pipeline/segment/slice_field.h"

namespace trocar::pipeline {
namespace {

constexpr int kStep_hu = 16;

/// Returns how many of the scan's own distances make at most `pitch_mm` and 5 %; at least 1.
double count_within(double pitch_mm, double own_mm, double most) {
  constexpr double kTolerance = 1.05;
  return std::clamp(std::floor(kTolerance * pitch_mm / own_mm), 1.0, most);
}

struct Blocks {
  int columns_each = 1, rows_each = 1;  // pixels of a block
  HuGrid grid;
};

Blocks blocks_of(const SlicePlane& plane, int width, int height, double pitch_mm,
                 const MeshOptions& options) {
  Blocks out;
  const auto each = [pitch_mm](double spacing_mm, int pixels) {
    const double wanted = count_within(pitch_mm, spacing_mm, kMaxHuSide);
    return std::max(static_cast<int>(wanted), 1 + (pixels - 1) / 4096);  // kMaxHuSamples in a plane
  };
  const double u = plane.spacing_u_mm, v = plane.spacing_v_mm;
  out.columns_each = each(u, width);
  out.rows_each = each(v, height);
  const Crop crop = options.crop.value_or(Crop{});
  HuGrid& grid = out.grid;
  grid.origin_mm = {((options.crop ? crop.x0 : 0) + 0.5 * (out.columns_each - 1)) * u,
                    ((options.crop ? crop.y0 : 0) + 0.5 * (out.rows_each - 1)) * v};
  grid.pitch_mm = {out.columns_each * u, out.rows_each * v};
  grid.columns = (width - 1) / out.columns_each + 1;
  grid.rows = (height - 1) / out.rows_each + 1;
  grid.step_hu = kStep_hu;
  return out;
}

// The planes of the grid along the scan: every `each`-th slice of the slices `first` to `last`.
struct PlaneSpacing {
  const SliceStack& stack;
  StackShape shape;
  int first = 0, last = 0, each = 1;
  double pitch_mm = 0;  // mean distance of the planes
};

struct SliceWeight {
  int slice = 0;
  double weight = 0;
};

// The slices that count in the plane at slice `index`, in ascending order. If the slices up to the
// next planes are evenly spaced, distances are numbers of slices, so that rounded positions do not
// change the weights. Otherwise distances are in mm.
std::vector<SliceWeight> weights_near(const PlaneSpacing& planes, int index) {
  const int before = index - planes.each, after = index + planes.each;  // the next planes
  const int low = std::max(planes.first, before), high = std::min(planes.last, after);
  bool is_even = true;
  for (int k = low; k < high; ++k)
    is_even = is_even && !planes.shape.is_uneven(static_cast<std::size_t>(k));
  const auto away_mm = [&planes, index](int k) {
    return std::abs(planes.stack.plane(k).z_mm - planes.stack.plane(index).z_mm);
  };
  // Without a plane on one side, the weights decrease there as on the other side.
  const bool has_before = before >= planes.first, has_after = after <= planes.last;
  const double before_mm = has_before  ? away_mm(before)
                           : has_after ? away_mm(after)
                                       : planes.pitch_mm;
  const double after_mm = has_after ? away_mm(after) : before_mm;
  const auto weight_of = [&](int k) -> double {
    if (is_even) return planes.each - std::abs(k - index);
    if (k == index) return 1;
    const double reach_mm = k < index ? before_mm : after_mm;
    return reach_mm > 0 ? 1 - away_mm(k) / reach_mm : 0;
  };
  std::vector<SliceWeight> out;
  for (int k = low; k <= high; ++k) {
    const double weight = weight_of(k);
    if (weight > 0) out.push_back({k, weight});
  }
  return out;
}

// Adds the blocks' means, times the weight.
void add_means(const Image& hu, const Blocks& blocks, double weight, std::vector<double>& sums) {
  const auto columns = static_cast<std::size_t>(blocks.grid.columns);
  std::vector<double> row(columns);
  for (int r = 0; r < blocks.grid.rows; ++r) {
    const int top = r * blocks.rows_each, bottom = std::min(hu.height, top + blocks.rows_each);
    std::fill(row.begin(), row.end(), 0.0);
    for (int y = top; y < bottom; ++y) {
      for (int x = 0; x < hu.width; ++x) {
        const auto value = static_cast<double>(hu.at(x, y));
        row[static_cast<std::size_t>(x / blocks.columns_each)] +=
            std::isfinite(value) ? value : static_cast<double>(kNoData_HU);
      }
    }
    for (std::size_t c = 0; c < columns; ++c) {
      const int left = static_cast<int>(c) * blocks.columns_each;
      const int pixels = (bottom - top) * (std::min(hu.width, left + blocks.columns_each) - left);
      sums[static_cast<std::size_t>(r) * columns + c] += weight * row[c] / pixels;
    }
  }
}

}  // namespace

double default_context_mm(const SlicePlane& plane, int width, int height) {
  const double size_mm = std::max(width * plane.spacing_u_mm, height * plane.spacing_v_mm);
  return size_mm <= 128 ? 2 : size_mm <= 256 ? 3 : 4;
}

Result<EncodedHuVolume> encode_context(const SliceStack& stack, int first, int last,
                                       double pitch_mm, const MeshOptions& options) {
  const int slices = last - first + 1;
  const double thick_mm =
      slices > 1 ? std::abs(stack.plane(last).z_mm - stack.plane(first).z_mm) / (slices - 1)
                 : pitch_mm;
  const int each = static_cast<int>(count_within(pitch_mm, std::max(thick_mm, 1e-6), slices));
  const int width = options.crop ? options.crop->x1 - options.crop->x0 + 1 : stack.width(),
            height = options.crop ? options.crop->y1 - options.crop->y0 + 1 : stack.height();
  const Blocks blocks = blocks_of(stack.plane(first), width, height, pitch_mm, options);
  EncodedHuVolume out{blocks.grid, {}};
  // The first plane is so placed that as many slices lie beyond it as beyond the last one.
  for (int index = first + (slices - 1) % each / 2; index <= last; index += each)
    out.planes.push_back({index, {}});
  const auto mask = hu_mask(blocks.grid, options.lattice, {});
  if (!mask) return mask.error();
  const PlaneSpacing spacing{stack, stack_shape(stack), first, last, each, each * thick_mm};
  std::vector<std::optional<Error>> errors(out.planes.size());
  parallel_for(static_cast<int>(out.planes.size()), [&](int i) {
    EncodedHuPlane& plane = out.planes[static_cast<std::size_t>(i)];
    std::vector<double> sums(mask->is_stored.size(), 0);
    double weights = 0;
    for (const auto& [slice, weight] : weights_near(spacing, plane.index)) {
      const auto image = read_cropped(stack, slice, options.crop);
      if (!image) {
        errors[static_cast<std::size_t>(i)] = image.error();
        return;
      }
      add_means(*image, blocks, weight, sums);
      weights += weight;
    }
    plane.bytes = encode_hu_plane(blocks.grid, *mask, [&](int column, int row) {
      return static_cast<float>(
          sums[static_cast<std::size_t>(row) * static_cast<std::size_t>(blocks.grid.columns) +
               static_cast<std::size_t>(column)] /
          weights);
    });
  });
  for (const auto& error : errors) {
    if (error) return *error;
  }
  return out;
}

}  // namespace trocar::pipeline
