// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/scan/hu_planes.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

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

}  // namespace trocar::pipeline
