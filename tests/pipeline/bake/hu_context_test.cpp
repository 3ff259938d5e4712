// SPDX-License-Identifier: GPL-3.0-or-later
// The weights of slices in the planes of the context: linear in their distance, whatever the
// distances between slices are.
#include "pipeline/bake/hu_planes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iterator>
#include <map>
#include <utility>
#include <vector>

#include "formats/asset/hu_codec.h"
#include "tests/support/memory_stack.h"

namespace trocar::pipeline {
namespace {

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
  auto made = encode_context(stack, 0, stack.size() - 1, pitch_mm, {});
  EXPECT_TRUE(made) << made.error().message;
  return std::move(*made);
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

TEST(HuContext, AGapSeparatesWhatLiesBesideIt) {
  std::vector<double> z_mm, hu;
  for (int k = 0; k < 20; ++k) {
    z_mm.push_back(k < 10 ? k : 20 + k);
    hu.push_back(k < 10 ? 0 : 1600);
  }
  const std::map<int, double> means = plane_means(context_of(FlatStack(z_mm, hu), 4));
  ASSERT_EQ(means.size(), 10U);  // every other slice
  for (const auto& [index, mean] : means)
    EXPECT_NEAR(mean,
                index == 10  ? 1600 * 1.5 / (1.5 + 1.0 / 22)
                : index < 10 ? 0
                             : 1600,
                16)
        << index;
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
