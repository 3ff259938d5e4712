// SPDX-License-Identifier: GPL-3.0-or-later
// The samples of HU: their grid, the fit to the pixels against dense least squares, and means over discs.
// The weights of slices in the planes of the context: linear in their distance, whatever the distances
// between slices are.
#include "pipeline/bake/hu_planes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iterator>
#include <limits>
#include <map>
#include <random>
#include <tuple>
#include <utility>
#include <vector>

#include "formats/asset/hu_codec.h"
#include "tests/reference/decompositions/decompositions.h"
#include "tests/support/memory_stack.h"
#include "tests/support/take.h"
#include "tests/support/test_lattice.h"

namespace trocar::pipeline {
namespace {

using trocar::test::kLattice;

Image noise_image(int width, int height, std::uint32_t seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> hu(300, 200);
  Image out{width, height, {}};
  for (int i = 0; i < width * height; ++i)
    out.values.push_back(hu(random));
  return out;
}

HuSampling sampling_of(double spacing_mm, int width, int height) {
  SlicePlane plane;
  plane.spacing_u_mm = plane.spacing_v_mm = spacing_mm;
  MeshOptions options;
  options.lattice = kLattice;
  return hu_sampling(plane, width, height, options);
}

HuMask whole(const HuGrid& grid) {
  return {0, 0, grid.columns, grid.rows,
          std::vector<char>(
              static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows), 1)};
}

TEST(HuSampling, HasAPitchOfAboutAMillimetre) {
  for (int i = 0; i < 69; ++i) {  // from 0.05 to 5 mm
    const double spacing_mm = 0.05 * std::pow(1.07, i);
    const HuSampling sampling = sampling_of(spacing_mm, 512, 400);
    const HuGrid& grid = sampling.grid;
    EXPECT_TRUE(check_hu_grid(grid, kLattice));
    EXPECT_DOUBLE_EQ(grid.pitch_mm.x(), sampling.columns_each * spacing_mm);
    if (sampling.columns_each > 1) {
      EXPECT_GT(grid.pitch_mm.x(), 0.57);
      EXPECT_LE(grid.pitch_mm.x(), 1.25);
    }
    EXPECT_GE(grid.pitch_mm.x(), spacing_mm);
    // The grid reaches the last pixel and ends less than a pitch behind it.
    const double last_mm = 511 * spacing_mm, end_mm = (grid.columns - 1) * grid.pitch_mm.x();
    EXPECT_GE(end_mm, last_mm - 1e-9);
    EXPECT_LT(end_mm, last_mm + grid.pitch_mm.x());
    EXPECT_GE(kLattice.to_mm(grid.margin_steps) + kLattice.step_mm(),
              std::max(1.5, grid.pitch_mm.x()));
  }
  EXPECT_TRUE(check_hu_grid(sampling_of(0.001, 32768, 2048).grid, Lattice{14}));
}

TEST(HuSampling, BeginsAtTheCrop) {
  SlicePlane plane;
  plane.spacing_u_mm = 0.4, plane.spacing_v_mm = 2;
  MeshOptions options;
  options.crop = Crop{10, 109, 5, 44};
  const HuSampling sampling = hu_sampling(plane, 100, 40, options);
  EXPECT_EQ(sampling.grid.origin_mm, Eigen::Vector2d(10 * 0.4, 5 * 2.0));
  EXPECT_EQ(sampling.columns_each, 2);
  EXPECT_EQ(sampling.rows_each, 1);
}

TEST(HuSamples, AreThePixelsWhereTheseAreCoarse) {
  const Image image = noise_image(20, 15, 1);
  const HuSampling sampling = sampling_of(1.2, 20, 15);
  EXPECT_EQ(hu_samples(image, sampling, whole(sampling.grid)), image.values);
  const HuMask box{3, 4, 5, 6, std::vector<char>(30, 1)};
  const std::vector<float> part = hu_samples(image, sampling, box);
  ASSERT_EQ(part.size(), 30U);
  for (int r = 0; r < 6; ++r) {
    for (int c = 0; c < 5; ++c)
      EXPECT_EQ(part[static_cast<std::size_t>(5 * r + c)], image.at(3 + c, 4 + r));
  }
}

// Every pixel is the bilinear function of the four samples around it: one dense system for all.
TEST(HuSamples, AreTheLeastSquaresFit) {
  for (const auto& [width, height, spacing_mm] :
       {std::tuple(13, 10, 0.4), std::tuple(14, 9, 0.3), std::tuple(17, 17, 0.25),
        std::tuple(11, 12, 0.5)}) {
    const Image image = noise_image(width, height, 7);
    const HuSampling sampling = sampling_of(spacing_mm, width, height);
    const int each = sampling.columns_each, columns = sampling.grid.columns;
    ASSERT_GT(each, 1);
    Eigen::MatrixXd basis = Eigen::MatrixXd::Zero(width * height, columns * sampling.grid.rows);
    Eigen::VectorXd pixels(width * height);
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        pixels[y * width + x] = static_cast<double>(image.at(x, y));
        for (int r = 0; r < sampling.grid.rows; ++r) {
          for (int c = 0; c < columns; ++c)
            basis(y * width + x, r * columns + c) =
                std::max(0.0, 1 - std::abs(x - c * each) / static_cast<double>(each)) *
                std::max(0.0, 1 - std::abs(y - r * each) / static_cast<double>(each));
        }
      }
    }
    const Eigen::VectorXd fit = reference::least_squares(basis, pixels);
    const std::vector<float> samples = hu_samples(image, sampling, whole(sampling.grid));
    ASSERT_EQ(static_cast<Eigen::Index>(samples.size()), fit.size());
    for (Eigen::Index i = 0; i < fit.size(); ++i)
      EXPECT_NEAR(samples[static_cast<std::size_t>(i)], fit[i], 0.01) << width << ": " << i;
  }
}

// The fit to the surroundings of a box, not to the whole image.
TEST(HuSamples, OfABoxAreThoseOfTheImage) {
  const Image image = noise_image(200, 150, 3);
  const HuSampling sampling = sampling_of(0.4, 200, 150);
  const std::vector<float> all = hu_samples(image, sampling, whole(sampling.grid));
  const HuMask box{30, 20, 25, 31, std::vector<char>(25 * 31, 1)};
  const std::vector<float> part = hu_samples(image, sampling, box);
  double sum2 = 0;
  for (int r = 0; r < box.rows; ++r) {
    for (int c = 0; c < box.columns; ++c) {
      const std::ptrdiff_t in_box = std::ptrdiff_t{r} * box.columns + c,
                           in_all = std::ptrdiff_t{r + box.first_row} * sampling.grid.columns + c +
                                    box.first_column;
      const auto error = static_cast<double>(part[static_cast<std::size_t>(in_box)] -
                                             all[static_cast<std::size_t>(in_all)]);
      EXPECT_LT(std::abs(error), 5);
      sum2 += error * error;
    }
  }
  EXPECT_LT(std::sqrt(sum2 / (25 * 31)), 1);
}

TEST(HuSamples, TakePixelsWithoutDataAsAir) {
  Image image = noise_image(9, 9, 5);
  image.values[40] = std::numeric_limits<float>::quiet_NaN();
  image.values[41] = std::numeric_limits<float>::infinity();
  const HuSampling sampling = sampling_of(1, 9, 9);
  const std::vector<float> samples = hu_samples(image, sampling, whole(sampling.grid));
  EXPECT_EQ(samples[40], kNoData_HU);
  EXPECT_TRUE(std::isfinite(samples[41]));
}

// Slices of 8 x 8 pixels of 1 mm, each of one value.
class FlatStack final : public MemoryStack {
 public:
  FlatStack(const std::vector<double>& z_mm, std::vector<double> hu) : hu_(std::move(hu)) {
    for (std::size_t k = 0; k < z_mm.size(); ++k) {
      images.push_back({8, 8, std::vector<float>(64, static_cast<float>(hu_[k]))});
      planes.push_back(axial_plane(1, z_mm[k]));
    }
  }
  double z_mm(int k) const { return plane(k).z_mm; }
  double hu(int k) const { return hu_[static_cast<std::size_t>(k)]; }

 private:
  std::vector<double> hu_;
};

EncodedHuVolume context_of(const FlatStack& stack, double pitch_mm) {
  return test::take(encode_context(stack, 0, stack.size() - 1, pitch_mm, {}));
}

// The mean HU of each plane, by the index of its slice. Samples have steps of 16 HU.
std::map<int, double> plane_means(const EncodedHuVolume& volume) {
  std::map<int, double> out;
  for (const EncodedHuPlane& plane : volume.planes) {
    const auto decoded = decode_hu_plane(plane.bytes, volume.grid, MeshOptions().lattice, {});
    EXPECT_TRUE(decoded) << decoded.error().message;
    double sum = 0;
    for (const float hu : decoded->hu)
      sum += static_cast<double>(hu);
    out[plane.index] = sum / static_cast<double>(decoded->hu.size());
  }
  return out;
}

// Values far from those of the neighbours.
std::vector<double> jumping_values(std::size_t count) {
  std::vector<double> out;
  for (std::size_t k = 0; k < count; ++k)
    out.push_back(1600.0 * static_cast<double>(k * k % 7));
  return out;
}

// Each slice counts as in linear interpolation between the planes.
TEST(HuContext, WeightsAreLinearInMillimetres) {
  const std::vector<double> z_mm = {0, 1, 2, 3, 4, 7, 8, 9, 20, 21, 22, 23, 24, 26, 28, 30};
  const FlatStack stack(z_mm, jumping_values(z_mm.size()));
  const std::map<int, double> means = plane_means(context_of(stack, 4));  // 2 mm on average
  ASSERT_EQ(means.size(), 8U);
  for (auto plane = std::next(means.begin()); plane != std::prev(means.end()); ++plane) {
    const int before = std::prev(plane)->first, here = plane->first,
              after = std::next(plane)->first;
    double sum = 0, weights = 0;
    for (int k = before; k <= after; ++k) {
      const double from = stack.z_mm(k <= here ? before : after);
      const double weight = (stack.z_mm(k) - from) / (stack.z_mm(here) - from);
      sum += weight * stack.hu(k);
      weights += weight;
    }
    EXPECT_NEAR(plane->second, sum / weights, 16) << here;
  }
}

TEST(HuContext, InEvenlySpacedSlicesSmallDifferencesChangeNothing) {
  std::vector<double> even_mm, almost_mm;
  for (int k = 0; k < 23; ++k) {
    even_mm.push_back(1.25 * k);
    almost_mm.push_back(1.25 * k + 1e-3 * (k % 3));
  }
  const std::vector<double> hu = jumping_values(even_mm.size());
  const FlatStack stack(even_mm, hu);
  const EncodedHuVolume even = context_of(stack, 4), almost = context_of({almost_mm, hu}, 4);
  ASSERT_EQ(even.planes.size(), almost.planes.size());
  for (std::size_t i = 0; i < even.planes.size(); ++i)
    EXPECT_EQ(even.planes[i].bytes, almost.planes[i].bytes) << i;
  constexpr int kEach = 3;
  for (const auto& [index, mean] : plane_means(even)) {
    double sum = 0, weights = 0;
    for (int k = 0; k < stack.size(); ++k) {
      const double weight = std::max(0, kEach - std::abs(k - index));
      sum += weight * stack.hu(k);
      weights += weight;
    }
    EXPECT_NEAR(mean, sum / weights, 16) << index;
  }
}

}  // namespace
}  // namespace trocar::pipeline
