// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/bake/hu_planes.h"

#include <iterator>

#include "pipeline/read/parallel_for.h"

namespace trocar::pipeline {
namespace {

constexpr double kMargin_mm = 1.5;
// Samples beyond the box that the fit takes along: the influence of a pixel falls to a quarter with each sample.
constexpr int kAround = 4;

// Pixels from one sample to the next.
int pixels_each(double spacing_mm, int pixels, int coarser) {
  const double each = coarser * std::max(1.0, std::floor(1 / spacing_mm + 0.25));
  const int coarsest = std::max(1, pixels / 2);  // two samples at least
  const int needed = 1 + (pixels - 1) / 4096;    // kMaxHuSamples in a plane
  return std::clamp(each < coarsest ? static_cast<int>(each) : coarsest, needed,
                    std::max(needed, coarsest));
}

int samples_of(int pixels, int each) {
  return (pixels - 1 + each - 1) / each + 1;
}

// Least squares of a piecewise linear function, with a knot at every `each`-th of n values, to the
// values along the rows of an n x width matrix, for each of its columns. `row_of(i)` points to row i,
// until it is called again. Returns the width x knots matrix of the values at the knots.
template <typename RowOf>
std::vector<double> fitted(RowOf row_of, int n, int width, int each) {
  const auto knots = static_cast<std::size_t>(samples_of(n, each));
  const auto w = static_cast<std::size_t>(width);
  // The normal equations are tridiagonal: solved by elimination, all columns at once.
  std::vector<double> diagonal(knots, 0), beside(knots, 0), right(knots * w, 0);
  for (int i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i / each);
    const double b = static_cast<double>(i % each) / each, a = 1 - b;
    const double* const row = row_of(i);
    diagonal[k] += a * a;
    for (std::size_t c = 0; c < w; ++c)
      right[k * w + c] += a * row[c];
    if (b == 0) continue;
    diagonal[k + 1] += b * b;
    beside[k] += a * b;
    for (std::size_t c = 0; c < w; ++c)
      right[(k + 1) * w + c] += b * row[c];
  }
  for (std::size_t k = 1; k < knots; ++k) {
    const double factor = beside[k - 1] / diagonal[k - 1];
    diagonal[k] -= factor * beside[k - 1];
    for (std::size_t c = 0; c < w; ++c)
      right[k * w + c] -= factor * right[(k - 1) * w + c];
  }
  for (std::size_t k = knots; k-- > 0;) {
    const double* const next = right.data() + std::min(k + 1, knots - 1) * w;
    const double factor = k + 1 < knots ? beside[k] : 0;
    for (std::size_t c = 0; c < w; ++c)
      right[k * w + c] = (right[k * w + c] - factor * next[c]) / diagonal[k];
  }
  using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const auto rows = static_cast<Eigen::Index>(knots), columns = static_cast<Eigen::Index>(w);
  std::vector<double> out(right.size());
  Eigen::Map<Matrix>(out.data(), columns, rows) =
      Eigen::Map<const Matrix>(right.data(), rows, columns).transpose();
  return out;
}

double finite_hu(float hu) {
  constexpr double kMost = 1e9;
  return std::isnan(hu) ? static_cast<double>(kNoData_HU)
                        : std::clamp(static_cast<double>(hu), -kMost, kMost);
}

// The pixels of a box.
std::vector<float> pixels_of(const Image& hu, const HuMask& box) {
  std::vector<float> out;
  out.reserve(static_cast<std::size_t>(box.columns) * static_cast<std::size_t>(box.rows));
  for (int y = box.first_row; y < box.first_row + box.rows; ++y) {
    for (int x = box.first_column; x < box.first_column + box.columns; ++x)
      out.push_back(static_cast<float>(finite_hu(hu.at(x, y))));
  }
  return out;
}

constexpr int kStep_hu = 16;

/// Returns how many of the scan's own distances make at most `pitch_mm` and 5 %; at least 1.
double count_within(double pitch_mm, double own_mm, double most) {
  constexpr double kTolerance = 1.05;
  return std::clamp(std::floor(kTolerance * pitch_mm / own_mm), 1.0, most);
}

struct HuBlocks {
  int columns_each = 1, rows_each = 1;  // pixels of a block
  HuGrid grid;
};

HuBlocks blocks_of(const SlicePlane& plane, int width, int height, double pitch_mm,
                   const MeshOptions& options) {
  HuBlocks out;
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
void add_means(const Image& hu, const HuBlocks& blocks, double weight, std::vector<double>& sums) {
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

HuSampling hu_sampling(const SlicePlane& plane, int width, int height, const MeshOptions& options,
                       int coarser) {
  HuSampling out;
  out.columns_each = pixels_each(plane.spacing_u_mm, width, coarser);
  out.rows_each = pixels_each(plane.spacing_v_mm, height, coarser);
  HuGrid& grid = out.grid;
  if (options.crop)
    grid.origin_mm = {options.crop->x0 * plane.spacing_u_mm, options.crop->y0 * plane.spacing_v_mm};
  grid.pitch_mm = {out.columns_each * plane.spacing_u_mm, out.rows_each * plane.spacing_v_mm};
  grid.columns = samples_of(width, out.columns_each);
  grid.rows = samples_of(height, out.rows_each);
  const double pitch_mm = grid.pitch_mm.maxCoeff();
  grid.step_hu = 8 * static_cast<int>(std::clamp(std::floor(9 / pitch_mm), 1.0, 12.0));
  grid.margin_steps = static_cast<std::int32_t>(
      std::min(std::rint(std::max(kMargin_mm, pitch_mm) / options.lattice.step_mm()),
               static_cast<double>(kMaxHuMargin)));
  return out;
}

std::vector<float> hu_samples(const Image& hu, const HuSampling& sampling, const HuMask& box) {
  if (sampling.columns_each == 1 && sampling.rows_each == 1) return pixels_of(hu, box);
  const int around_x = sampling.columns_each > 1 ? kAround : 0,
            around_y = sampling.rows_each > 1 ? kAround : 0;
  const int first_column = std::max(0, box.first_column - around_x),
            first_row = std::max(0, box.first_row - around_y);
  const int left = first_column * sampling.columns_each, top = first_row * sampling.rows_each;
  const int right = std::min(hu.width - 1, (box.first_column + box.columns - 1 + around_x) *
                                               sampling.columns_each),
            bottom = std::min(hu.height - 1,
                              (box.first_row + box.rows - 1 + around_y) * sampling.rows_each);
  const int width = right - left + 1, height = bottom - top + 1;
  std::vector<double> pixels(static_cast<std::size_t>(width));
  const auto row_of_pixels = [&](int y) {
    const auto row = hu.values.begin() + static_cast<std::ptrdiff_t>(top + y) * hu.width + left;
    std::transform(row, row + width, pixels.begin(), finite_hu);
    return pixels.data();
  };
  const std::vector<double> by_column = fitted(row_of_pixels, height, width, sampling.rows_each);
  const int rows = samples_of(height, sampling.rows_each);
  const auto row_of_columns = [&](int x) {
    return by_column.data() + static_cast<std::ptrdiff_t>(x) * rows;
  };
  const std::vector<double> values = fitted(row_of_columns, width, rows, sampling.columns_each);
  const int columns = samples_of(width, sampling.columns_each);
  std::vector<float> out;
  out.reserve(static_cast<std::size_t>(box.columns) * static_cast<std::size_t>(box.rows));
  for (int r = box.first_row; r < box.first_row + box.rows; ++r) {
    const auto row = values.begin() + static_cast<std::ptrdiff_t>(r - first_row) * columns +
                     (box.first_column - first_column);
    std::transform(row, row + box.columns, std::back_inserter(out),
                   [](double value) { return static_cast<float>(value); });
  }
  return out;
}

Result<EncodedHu> encode_hu(int index, const Image& hu, const HuSampling& sampling,
                            const Lattice& lattice, Outlines outlines) {
  EncodedHu out{{index, {}}};
  const auto mask = hu_mask(sampling.grid, lattice, outlines);
  if (!mask) return mask.error();
  if (mask->is_stored.empty()) return out;
  out.samples = std::int64_t{mask->columns} * mask->rows;
  const std::vector<float> samples = hu_samples(hu, sampling, *mask);
  out.bytes = encode_hu_plane(sampling.grid, *mask, [&](int column, int row) {
    return samples[static_cast<std::size_t>(row - mask->first_row) *
                       static_cast<std::size_t>(mask->columns) +
                   static_cast<std::size_t>(column - mask->first_column)];
  });
  return out;
}

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
  const HuBlocks blocks = blocks_of(stack.plane(first), width, height, pitch_mm, options);
  EncodedHuVolume out{blocks.grid, {}};
  // The first plane is so placed that as many slices lie beyond it as beyond the last one.
  for (int index = first + (slices - 1) % each / 2; index <= last; index += each)
    out.planes.push_back({index, {}});
  const auto mask = hu_mask(blocks.grid, options.lattice, {});
  if (!mask) return mask.error();
  const PlaneSpacing spacing{stack, stack_shape(stack), first, last, each, each * thick_mm};
  const auto done =
      try_in_parallel(static_cast<int>(out.planes.size()), [&](int i) -> Result<void> {
        EncodedHuPlane& plane = out.planes[static_cast<std::size_t>(i)];
        std::vector<double> sums(mask->is_stored.size(), 0);
        double weights = 0;
        for (const auto& [slice, weight] : weights_near(spacing, plane.index)) {
          const auto image = read_cropped(stack, slice, options.crop);
          if (!image) return image.error();
          add_means(*image, blocks, weight, sums);
          weights += weight;
        }
        plane.bytes = encode_hu_plane(blocks.grid, *mask, [&](int column, int row) {
          return static_cast<float>(
              sums[static_cast<std::size_t>(row) * static_cast<std::size_t>(blocks.grid.columns) +
                   static_cast<std::size_t>(column)] /
              weights);
        });
        return {};
      });
  if (!done) return done.error();
  return out;
}

}  // namespace trocar::pipeline
