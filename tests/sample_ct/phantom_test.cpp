// SPDX-License-Identifier: Apache-2.0
// The laws of the phantom's distances, its anatomy, and the scanner's apertures and noise.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <tuple>
#include <vector>

#include "sample_ct/phantom.h"
#include "sample_ct/random.h"
#include "sample_ct/render.h"
#include "tests/reference/phantom/cross_section.h"

namespace trocar::sample {
namespace {

constexpr double kPi = std::numbers::pi;

double uniform(std::mt19937_64& bits, double low, double high) {
  return low + (high - low) * 0.5 * (1 + signed_unit(bits()));
}
Vec3 random_point(std::mt19937_64& bits) {
  return {uniform(bits, -60, 60), uniform(bits, -30, 85), uniform(bits, -30, 30)};
}
Vec3 random_direction(std::mt19937_64& bits) {
  const double z = uniform(bits, -1, 1), angle = uniform(bits, 0, 2 * kPi);
  const double r = std::sqrt(1 - z * z);
  return {r * std::cos(angle), r * std::sin(angle), z};
}

/// The values of t at which from + t * direction (0 <= t <= length) crosses the bone's surface,
/// by steps of the distance (sphere tracing): needs law 1 only.
std::vector<double> surface_crossings(Vec3 from, Vec3 direction, double length) {
  std::vector<double> at;
  double t = 0, d = bone_distance_mm(from);
  while (t < length) {
    const double step = std::max(std::abs(d), 5e-4);
    const double next = bone_distance_mm(from + (t + step) * direction);
    if ((d < 0) != (next < 0)) at.push_back(t + step * d / (d - next));
    t += step;
    d = next;
  }
  return at;
}

// --- Distances and anatomy -------------------------------------------------

TEST(BoneDistance, IsOneLipschitz) {
  std::mt19937_64 bits(11);
  for (int n = 0; n < 200000; ++n) {
    const Vec3 p = random_point(bits);
    const double step = std::pow(10.0, uniform(bits, -6, 1.5));
    const Vec3 q = p + step * random_direction(bits);
    const double change = std::abs(bone_distance_mm(p) - bone_distance_mm(q));
    ASSERT_LE(change, norm(p - q) * (1 + 1e-9) + 1e-12)
        << "at " << p.x << " " << p.y << " " << p.z << ", step " << step;
  }
}

TEST(BoneDistance, HasTheSignAndNeverExceedsThePlanarDistance) {
  const PhantomOptions phantom;
  std::mt19937_64 bits(13);
  for (const double z : {-17.0, -8.5, 0.25, 6.0, 13.0, 17.0}) {
    const Result<CrossSection> section = surface_section(phantom, z);
    ASSERT_TRUE(section) << section.error().message;
    const SectionDistance planar(*section);
    for (int n = 0; n < 4000; ++n) {
      const Vec2 p{uniform(bits, -60, 60), uniform(bits, -30, 85)};
      const double d = bone_distance_mm(phantom, Vec3{p.x, p.y, z}), exact = planar(p);
      if (std::abs(exact) > 2e-3) {
        ASSERT_EQ(d < 0, exact < 0) << p.x << " " << p.y << " " << z;
      }
      ASSERT_LE(std::abs(d), std::abs(exact) + 2e-3) << p.x << " " << p.y << " " << z;
    }
  }
}

TEST(Anatomy, HasTheSizesOfALumbarVertebra) {
  const auto width = [](Vec3 from, Vec3 direction, double length) {
    const std::vector<double> at = surface_crossings(from, direction, length);
    return at.size() < 2 ? 0.0 : at.back() - at.front();
  };
  const Vec3 x{1, 0, 0}, y{0, 1, 0}, z{0, 0, 1};
  EXPECT_NEAR(width({-40, 2, 11}, x, 80), 45, 1.5);   // body, near its upper rim
  EXPECT_NEAR(width({-40, 2, 0}, x, 80), 41.5, 1.5);  // and at its waist
  EXPECT_NEAR(width({6, -30, 12}, y, 48), 33, 1.5);   // body, front to back
  EXPECT_NEAR(width({0, 0, -19}, z, 38), 25.5, 1.0);  // body, between the end-plates
  const std::vector<double> canal_x = surface_crossings({0, 23, 3}, x, 20);
  ASSERT_FALSE(canal_x.empty());
  EXPECT_NEAR(2 * canal_x.front(), 23, 1.5);
  const std::vector<double> canal_y = surface_crossings({0, 22, 1}, y, 60);
  ASSERT_GE(canal_y.size(), 2u);
  EXPECT_NEAR(22 + canal_y.front() - 16, 16, 2.0);  // from the body's rear wall
  EXPECT_NEAR(22 + surface_crossings({0, 22, -12}, y, 60).back() - 32.5, 38, 3.0);  // spinous tip
  // The transverse processes reach about 45 mm to the side.
  double reach = 0;
  for (int half_mm = 70; half_mm < 104; ++half_mm)
    for (const double t : surface_crossings({30, 0.5 * half_mm, 4}, x, 30))
      reach = std::max(reach, 30 + t);
  EXPECT_NEAR(reach, 45, 1.5);
  // The facet joints are open: bone, joint space of about 2 mm, bone.
  const std::vector<double> joint = surface_crossings({10.9, 36.0, 14.5}, {0.893, -0.450, 0}, 16);
  ASSERT_EQ(joint.size(), 3u);
  EXPECT_NEAR(joint[1] - joint[0], 2.0, 0.4);
}

TEST(Anatomy, IsMirroredAndItsPlacementIsInvertible) {
  std::mt19937_64 bits(14);
  for (int n = 0; n < 2000; ++n) {
    const Vec3 p = random_point(bits);
    EXPECT_EQ(bone_distance_mm(p), bone_distance_mm(Vec3{-p.x, p.y, p.z}));
    const PhantomOptions phantom;
    const Vec3 back = to_anatomy(phantom, to_scan(phantom, p));
    EXPECT_NEAR(norm(back - p), 0, 1e-12);
  }
}

TEST(Field, CoreReadsAbove270AndSoftTissueBelowTheThreshold) {
  const PhantomOptions phantom;
  std::mt19937_64 bits(15);
  int core = 0, soft = 0;
  for (int n = 0; n < 200000; ++n) {
    const Vec3 p = random_point(bits);
    const BoneSample bone = sample_bone(phantom, p);
    const double hu = field_hu(phantom, p);
    if (bone.distance_mm < -0.4) {  // one sigma of the edge's blur inside
      ++core;
      ASSERT_GE(hu, 270) << p.x << " " << p.y << " " << p.z;
    } else if (bone.distance_mm > 1.5) {
      ++soft;
      ASSERT_LE(hu, 110);
    }
  }
  EXPECT_GT(core, 10000);
  EXPECT_GT(soft, 100000);
}

// --- The scanner -----------------------------------------------------------

TEST(PartialVolume, OfASharpFlatEdgeIsTheCoveredShare) {
  ScanGeometry scan;
  scan.subsamples_xy = 5;
  scan.subsamples_z = 4;
  const auto below = [](double z0) { return [z0](Vec3 p) { return p.z < z0 ? 1.0 : 0.0; }; };
  for (int quarter = 0; quarter <= 4; ++quarter)
    EXPECT_DOUBLE_EQ(aperture_mean<double>(scan, {3, 4, 10}, below(9.5 + 0.25 * quarter)),
                     0.25 * quarter);
  const auto left = [](Vec3 p) { return p.x < 3 + 0.3 * 0.3125 ? 1.0 : 0.0; };
  EXPECT_DOUBLE_EQ(aperture_mean<double>(scan, {3, 4, 10}, left), 0.8);
}

TEST(PartialVolume, AgreesWithFineSamplingOfTheWholeField) {
  PhantomOptions phantom;
  phantom.tissue.cancellous_texture = 0;
  phantom.tissue.soft_texture = 0;
  const ScanGeometry scan;
  ScanGeometry fine = scan;
  fine.subsamples_xy = 8;
  fine.subsamples_z = 12;
  std::mt19937_64 bits(31);
  double worst = 0, sum2 = 0;
  int edges = 0;
  while (edges < 600) {
    const Vec3 p = random_point(bits);
    if (std::abs(bone_distance_mm(phantom, p)) > 2.5) continue;
    ++edges;
    const double exact =
        aperture_mean<double>(fine, p, [&](Vec3 q) { return field_hu(phantom, q); });
    const double error = scanner_hu(phantom, scan, p) - exact;
    worst = std::max(worst, std::abs(error));
    sum2 += error * error;
  }
  EXPECT_LT(std::sqrt(sum2 / edges), 6.0);
  EXPECT_LT(worst, 40.0);
}

TEST(Noise, HasTheStatedSpreadAndCorrelation) {
  const Result<ScanGeometry> scan = sample_geometry(512, 35);
  ASSERT_TRUE(scan);
  const std::vector<double> a = noise_slice(*scan, 7, 12, 3), b = noise_slice(*scan, 7, 12, 4);
  const std::vector<double> c = noise_slice(*scan, 8, 12, 3);
  const auto covariance = [&](const std::vector<double>& u, const std::vector<double>& v, int di,
                              int dj) {
    double sum = 0;
    int count = 0;
    for (int j = 0; j + dj < 512; ++j)
      for (int i = 0; i + di < 512; ++i, ++count)
        sum += u[j * 512 + i] * v[(j + dj) * 512 + i + di];
    return sum / count;
  };
  double mean = 0;
  int beyond_two_sigma = 0;
  for (const double v : a)
    mean += v, beyond_two_sigma += std::abs(v) > 24;
  const double n = 512.0 * 512.0;
  EXPECT_NEAR(mean / n, 0, 0.25);  // five standard errors, including the correlation
  EXPECT_NEAR(beyond_two_sigma / n, 0.0455, 0.004);
  EXPECT_NEAR(std::sqrt(covariance(a, a, 0, 0)), 12, 0.15);
  for (const auto& [di, dj, expected] : {std::tuple{1, 0, 4.0 / 9},
                                         {0, 1, 4.0 / 9},
                                         {2, 0, 1.0 / 18},
                                         {0, 2, 1.0 / 18},
                                         {1, 1, 16.0 / 81},
                                         {3, 0, 0.0},
                                         {0, 7, 0.0}})
    EXPECT_NEAR(covariance(a, a, di, dj) / 144, expected, 0.02) << di << " " << dj;
  EXPECT_NEAR(covariance(a, b, 0, 0) / 144, 0, 0.02);
  EXPECT_NEAR(covariance(a, c, 0, 0) / 144, 0, 0.02);
}

TEST(Scan, DependsOnTheSeedAndNotOnTheThreads) {
  const Result<ScanGeometry> geometry = sample_geometry(96, 7);
  ASSERT_TRUE(geometry);
  PhantomOptions phantom;
  phantom.seed = 5;
  const Scan one = render_scan(phantom, *geometry, 12, 1),
             many = render_scan(phantom, *geometry, 12, 5);
  EXPECT_EQ(one.hu, many.hu);
  phantom.seed = 6;
  EXPECT_NE(one.hu, render_scan(phantom, *geometry, 12, 2).hu);
}

TEST(Scan, AddsTheNoiseAndRoundsOnce) {
  const Result<ScanGeometry> geometry = sample_geometry(128, 3);
  ASSERT_TRUE(geometry);
  const PhantomOptions phantom;
  const Scan scan = render_scan(phantom, *geometry, 12);
  for (int k = 0; k < 3; ++k) {
    const std::vector<double> clean = render_slice(phantom, *geometry, k);
    const std::vector<double> noise = noise_slice(*geometry, phantom.seed, 12, k);
    for (int j = 0; j < 128; ++j)
      for (int i = 0; i < 128; ++i) {
        const int at = j * 128 + i;
        // Skipping along a row must not change a pixel.
        ASSERT_NEAR(clean[at], scanner_hu(phantom, *geometry, pixel_centre_mm(*geometry, i, j, k)),
                    1e-9);
        ASSERT_EQ(scan.slice(k)[at],
                  std::clamp<long>(std::lround(clean[at] + noise[at]), kMinHu, kMaxHu));
      }
  }
}

}  // namespace
}  // namespace trocar::sample
