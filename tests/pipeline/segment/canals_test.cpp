// SPDX-License-Identifier: GPL-3.0-or-later
// The filling of bone on phantoms of a spinal column, whose canal, marrow and vessels are known.
#include "pipeline/segment/canals.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "pipeline/segment/solid_bone.h"
#include "tests/support/memory_stack.h"
#include "tests/support/take.h"

namespace trocar::pipeline {
namespace {

enum class Tissue { kSoft, kCanal, kDisc, kMarrow, kCortex, kVessel };

struct CanalPhantom {
  double pixel_mm = 1, slice_mm = 1.5, noise_HU = 0;
  double tilt = 0.3;  // shift of the canal per mm along the body
  double length_mm = 60;
  // Radius of the column's curve in the sagittal plane, in place of a tilt: positive if the column
  // is convex towards the back (kyphosis), negative if convex towards the front, 0 if straight.
  double curve_mm = 0;
  bool has_vessels = false;
  double marrow_HU = 58, vessel_HU = 300, cortex_mm = 1.2;
  SliceAxis axis = SliceAxis::kAxial;
};

constexpr double kPeriod_mm = 25;

// Vertebrae of cortex around dark marrow, 25 mm apart, with a canal of 16 x 15 mm, pedicles,
// laminae with gaps, foramina and discs. x left, y back, z up, in mm; the canal is at 0, 0.
Tissue tissue_at(const CanalPhantom& phantom, double x, double y, double z) {
  if (phantom.curve_mm == 0) {
    y -= phantom.tilt * (z - 30);
  } else {
    const double radius = std::abs(phantom.curve_mm), back = phantom.curve_mm > 0 ? 1 : -1;
    const double along = z - phantom.length_mm / 2, away = back * y + radius;
    y = back * (std::hypot(along, away) - radius);
    z = phantom.length_mm / 2 + radius * std::atan2(along, away);
  }
  const double level = z - kPeriod_mm * std::floor(z / kPeriod_mm) - kPeriod_mm / 2;
  const double from_canal = (std::hypot(x / 8, y / 7.5) - 1) * 7.5;
  if (from_canal < 0) return Tissue::kCanal;
  const double body_side = (std::hypot(x / 15, (y + 20.5) / 13) - 1) * 13;
  const double body = std::max({body_side, std::abs(level) - 10, -from_canal});
  const double side = std::abs(x);
  const double pedicle =
      std::max({std::abs(side - 11.5) - 3.5, std::abs(level - 3) - 6, -14 - y, y - 6});
  const double lamina =
      std::max({from_canal - 5, -from_canal, 0.5 - y, std::abs(level + 1) - kPeriod_mm / 2 + 2});
  const double process = std::max({side - 3, std::abs(level + 2) - 6, 8 - y, y - 28});
  const double bone = std::min({body, pedicle, lamina, process});
  if (bone < 0) return bone > -phantom.cortex_mm ? Tissue::kCortex : Tissue::kMarrow;
  if (body_side < 0) return Tissue::kDisc;
  if (!phantom.has_vessels) return Tissue::kSoft;
  const bool is_aorta = std::hypot(x - 5, y + 45) < 11.5;
  const bool is_bridge = std::abs(x - 3) < 3 && std::abs(z - 30) < 3 && y < -32 && y > -45;
  const bool is_heart = std::hypot(x / 30, (y + 80) / 24, (z - 30) / 32) < 1;
  return is_aorta || is_bridge || is_heart ? Tissue::kVessel : Tissue::kSoft;
}

double hu_of(const CanalPhantom& phantom, Tissue tissue) {
  switch (tissue) {
    case Tissue::kCanal:
      return 20;
    case Tissue::kDisc:
      return 100;
    case Tissue::kMarrow:
      return phantom.marrow_HU;
    case Tissue::kCortex:
      return 600;
    case Tissue::kVessel:
      return phantom.vessel_HU;
    default:
      return 50;
  }
}

// The phantom within x -45 to 45, y -65 to 40 (-110 with vessels), z 0 to length_mm. Each voxel is
// the mean of 2 x 2 x 2 points.
class ColumnStack final : public MemoryStack {
 public:
  explicit ColumnStack(const CanalPhantom& phantom) {
    const double front = phantom.has_vessels ? -110 : -65;
    std::mt19937_64 random(7);
    std::normal_distribution<double> noise(0, 1);
    const bool is_sagittal = phantom.axis == SliceAxis::kSagittal;
    const double a_mm = phantom.pixel_mm, b_mm = phantom.slice_mm;
    // Steps along x, y, z. Sagittal slices run along x, with rows along z.
    const Eigen::Vector3d step =
        is_sagittal ? Eigen::Vector3d(b_mm, a_mm, a_mm) : Eigen::Vector3d(a_mm, a_mm, b_mm);
    const auto count = [](double length, double by) { return static_cast<int>(length / by); };
    const int nx = count(90, step.x()), ny = count(40 - front, step.y()),
              nz = count(phantom.length_mm, step.z());
    const int width = is_sagittal ? ny : nx, height = is_sagittal ? nz : ny,
              slices = is_sagittal ? nx : nz;
    for (int k = 0; k < slices; ++k) {
      std::vector<Tissue>& tissue = tissue_.emplace_back();
      images.push_back(image_of(width, height, [&](int u, int v) {
        const Eigen::Vector3d index =
            is_sagittal ? Eigen::Vector3d(k, u, v) : Eigen::Vector3d(u, v, k);
        const Eigen::Vector3d at = Eigen::Vector3d(-45, front, 0) + index.cwiseProduct(step);
        const auto [hu, middle] = voxel(phantom, at, step);
        tissue.push_back(middle);
        return hu + phantom.noise_HU * noise(random);
      }));
      SlicePlane plane{a_mm, a_mm, Eigen::Affine3d::Identity(), k * b_mm};
      if (is_sagittal) plane.T_lps_plane.linear() << 0, 0, 1, 1, 0, 0, 0, 1, 0;
      plane.T_lps_plane.translation() = plane.T_lps_plane.linear().col(2) * (k * b_mm);
      planes.push_back(plane);
    }
  }
  Tissue tissue(int slice, int u, int v) const {
    return tissue_[slice][static_cast<std::size_t>(v) * width() + u];
  }

 private:
  static std::pair<double, Tissue> voxel(const CanalPhantom& phantom, const Eigen::Vector3d& at,
                                         const Eigen::Vector3d& step) {
    double sum = 0;
    for (int i = 0; i < 8; ++i) {
      const Eigen::Vector3d part((i & 1) - 0.5, (i >> 1 & 1) - 0.5, (i >> 2 & 1) - 0.5);
      const Eigen::Vector3d p = at + 0.5 * part.cwiseProduct(step);
      sum += hu_of(phantom, tissue_at(phantom, p.x(), p.y(), p.z()));
    }
    return {sum / 8, tissue_at(phantom, at.x(), at.y(), at.z())};
  }

  std::vector<std::vector<Tissue>> tissue_;
};

SolidBone filled(const ColumnStack& stack, bool column = false) {
  SolidOptions options;
  options.close_mm = 3;
  options.fill_mm2 = 2500;
  options.min_volume_mm3 = 100;
  options.column = column;
  return test::take(SolidBone::make(stack, Threshold{180}, SliceAxis::kAxial, options));
}

// The largest part of the canal that is filled in a slice, of its pixels that touch no other
// tissue.
double canal_filled(const ColumnStack& stack, const SolidBone& solid) {
  double out = 0;
  for (int k = 0; k < stack.size(); ++k) {
    const Image image = *stack.read(k);
    int count = 0, wrong = 0;
    for (int v = 1; v + 1 < stack.height(); ++v) {
      for (int u = 1; u + 1 < stack.width(); ++u) {
        bool is_inner = true;
        for (int b = -1; b <= 1; ++b)
          for (int a = -1; a <= 1; ++a)
            is_inner = is_inner && stack.tissue(k, u + a, v + b) == Tissue::kCanal;
        if (!is_inner) continue;
        ++count;
        wrong += solid.inside(k, u, v) && image.at(u, v) < 180 ? 1 : 0;
      }
    }
    if (count >= 20) out = std::max(out, static_cast<double>(wrong) / count);
  }
  return out;
}

double part_inside(const ColumnStack& stack, const SolidBone& solid, Tissue tissue) {
  int count = 0, inside = 0;
  for (int k = 0; k < stack.size(); ++k) {
    for (int v = 0; v < stack.height(); ++v) {
      for (int u = 0; u < stack.width(); ++u) {
        if (stack.tissue(k, u, v) != tissue) continue;
        ++count;
        inside += solid.inside(k, u, v) ? 1 : 0;
      }
    }
  }
  return static_cast<double>(inside) / count;
}

TEST(Canals, TheSpinalCanalStaysOpenAtAllNoiseLevelsAndSliceDistances) {
  for (const double noise_HU : {0.0, 15.0, 30.0, 45.0, 60.0}) {
    for (const double slice_mm : {0.6, 1.5, 3.0}) {
      const CanalPhantom phantom{.pixel_mm = 1, .slice_mm = slice_mm, .noise_HU = noise_HU};
      const ColumnStack stack(phantom);
      const SolidBone solid = filled(stack);
      EXPECT_LE(canal_filled(stack, solid), 0.01) << noise_HU << " HU, " << slice_mm << " mm";
      if (slice_mm > 2) continue;
      EXPECT_GT(part_inside(stack, solid, Tissue::kMarrow), 0.8) << noise_HU << ", " << slice_mm;
    }
  }
}

TEST(Canals, AnObliqueCanalStaysOpen) {
  for (const double tilt : {-0.6, 0.0, 0.6}) {
    const ColumnStack stack(CanalPhantom{.noise_HU = 20, .tilt = tilt});
    EXPECT_LE(canal_filled(stack, filled(stack)), 0.01) << tilt;
  }
}

TEST(Canals, TheCanalOfACurvedColumnStaysOpen) {
  for (const double curve_mm : {-120.0, 120.0}) {
    for (const double noise_HU : {0.0, 60.0}) {
      for (const double slice_mm : {1.5, 3.0}) {
        const ColumnStack stack(CanalPhantom{
            .slice_mm = slice_mm, .noise_HU = noise_HU, .length_mm = 120, .curve_mm = curve_mm});
        const SolidBone solid = filled(stack);
        EXPECT_LE(canal_filled(stack, solid), 0.01)
            << curve_mm << ", " << noise_HU << " HU, " << slice_mm << " mm";
        EXPECT_GT(part_inside(stack, solid, Tissue::kMarrow), 0.8) << curve_mm << ", " << slice_mm;
      }
    }
  }
}

// Slices across the canal's planes need not be evenly spaced, as in sagittal slices with a gap. The
// canal jumps by three columns of 1.5 mm where its ring opens; a pixel's width beyond its last
// section, half of it goes on.
TEST(Canals, ACanalIsFollowedByTheWidthOfTheLocalPixel) {
  VoxelGrid grid;
  grid.at_mm[0] = {0, 0.2};
  grid.at_mm[2] = {0, 0.5, 1, 1.5, 2};
  for (int i = 0; i < 20; ++i)
    grid.at_mm[0].push_back(1.7 + 1.5 * i);
  for (int i = 0; i < 40; ++i)
    grid.at_mm[1].push_back(0.5 * i);
  std::vector<std::uint8_t> material(grid.size(), 1), flags(grid.size(), 0);
  const VoxelPlanes planes(grid, 2);
  for (std::size_t k = 0; k < planes.count(); ++k) {
    const std::size_t from = k < 3 ? 6 : 9;
    for (std::size_t y = 12; y < 28; ++y) {
      for (std::size_t x = from; x < from + 4; ++x) {
        material[planes.voxel(k, x, y)] = 0;
        flags[planes.voxel(k, x, y)] =
            static_cast<std::uint8_t>(k < 3 ? kWide | kEnclosed : unsigned{kWide});
      }
    }
  }
  EXPECT_EQ(find_canals(planes, material, {}, flags).size(), 1U);
}

TEST(Canals, TheCanalIsFoundInSagittalSlicesToo) {
  const ColumnStack stack(CanalPhantom{.noise_HU = 20, .axis = SliceAxis::kSagittal});
  EXPECT_LE(canal_filled(stack, filled(stack)), 0.01);
}

TEST(Canals, VesselsAreNamedAndLeftOutOfTheColumn) {
  const ColumnStack stack(CanalPhantom{.noise_HU = 20, .has_vessels = true});
  const SolidBone all = filled(stack), column = filled(stack, true);
  ASSERT_EQ(all.warnings().size(), 1U);
  EXPECT_EQ(all.warnings()[0].code, "contrast_filled");
  EXPECT_NE(all.warnings()[0].sentence.find("connected to bone"), std::string::npos);
  EXPECT_GT(part_inside(stack, all, Tissue::kVessel), 0.95);
  EXPECT_LT(part_inside(stack, column, Tissue::kVessel), 0.03);
  // Without the vessels, marrow that the end of the scan cuts stays open.
  EXPECT_GT(part_inside(stack, all, Tissue::kMarrow), 0.99);
  EXPECT_GT(part_inside(stack, column, Tissue::kMarrow), 0.92);
  EXPECT_LE(canal_filled(stack, column), 0.01);
}

// Marrow below 4 HU, such as fat, and such voxels of noisy marrow.
TEST(Canals, DarkMarrowIsFilledInTheColumnBesideVesselsToo) {
  for (const auto& [noise_HU, marrow_HU] : {std::pair(0.0, -40.0), std::pair(45.0, 58.0)}) {
    const ColumnStack stack(
        CanalPhantom{.noise_HU = noise_HU, .has_vessels = true, .marrow_HU = marrow_HU});
    EXPECT_GT(part_inside(stack, filled(stack), Tissue::kMarrow), 0.99) << marrow_HU;
    EXPECT_GT(part_inside(stack, filled(stack, true), Tissue::kMarrow), 0.9) << marrow_HU;
  }
}

// The aorta of a CT angiography lies on the vertebrae. Its limit of 580 HU is in the highest step
// of packed HU, in which all higher values are, too.
TEST(Canals, CortexBesideABrightVesselStays) {
  const ColumnStack stack(CanalPhantom{.has_vessels = true, .vessel_HU = 480, .cortex_mm = 4});
  const SolidBone all = filled(stack), column = filled(stack, true);
  EXPECT_LT(part_inside(stack, column, Tissue::kVessel), 0.05);
  EXPECT_GT(part_inside(stack, column, Tissue::kCortex),
            part_inside(stack, all, Tissue::kCortex) - 0.05);
  int dense = 0, missing = 0;
  for (int k = 0; k < stack.size(); ++k) {
    const Image image = *stack.read(k);
    for (int v = 0; v < stack.height(); ++v) {
      for (int u = 0; u < stack.width(); ++u) {
        if (image.at(u, v) < 599 || !all.inside(k, u, v)) continue;
        ++dense;
        missing += column.inside(k, u, v) ? 0 : 1;
      }
    }
  }
  EXPECT_GT(dense, 1000);
  EXPECT_EQ(missing, 0) << "of " << dense;
}

TEST(Canals, WithoutContrastNothingIsNamed) {
  const ColumnStack stack(CanalPhantom{.noise_HU = 20});
  EXPECT_TRUE(filled(stack).warnings().empty());
}

TEST(Canals, PackedValuesAreTrueToHalfAStep) {
  for (int i = 0; i < 218; ++i) {
    const float value = -200 + 3.5F * static_cast<float>(i);
    EXPECT_NEAR(unpacked_hu(packed_hu(value)), double{value}, 6);
  }
  EXPECT_GT(unpacked_hu(packed_hu(3000)), 550);
  EXPECT_LT(unpacked_hu(packed_hu(-1000)), -190);
  for (const unsigned flags : {0U, 3U}) {  // the lower two bits
    const auto is_highest = [flags](float value) {
      return is_in_highest_step(static_cast<std::uint8_t>(packed_hu(value) | flags));
    };
    EXPECT_TRUE(is_highest(556));
    EXPECT_TRUE(is_highest(3000));
    EXPECT_FALSE(is_highest(555));
    EXPECT_FALSE(is_highest(-1000));
  }
}

// A ball of 24 mm with a darker rim of 6 mm, in blocks of one voxel.
struct FadingBall {
  SoftRegions soft;
  std::size_t blocks = 0, missed = 0;  // blocks of the ball, and those that are not soft
  std::uint16_t highest_limit_HU = 0;
};

FadingBall fading_ball(float inside_HU, float rim_HU, float outside_HU, double threshold_HU) {
  constexpr int kBlocks = 40;
  constexpr double kRadius_mm = 24, kRim_mm = 6;
  VoxelGrid grid;
  for (std::vector<double>& at_mm : grid.at_mm)
    for (int i = 0; i < kBlocks; ++i)
      at_mm.push_back(kBlock_mm * i);
  BlockMeans means(grid);
  std::vector<std::size_t> ball;
  for (int z = 0; z < kBlocks; ++z) {
    Image image{kBlocks, kBlocks, {}};
    for (int y = 0; y < kBlocks; ++y) {
      for (int x = 0; x < kBlocks; ++x) {
        const double middle = (kBlocks - 1) / 2.0;
        const double r_mm = kBlock_mm * std::hypot(x - middle, y - middle, z - middle);
        if (r_mm < kRadius_mm)
          ball.push_back(means.block(static_cast<std::size_t>(x), static_cast<std::size_t>(y),
                                     static_cast<std::size_t>(z)));
        image.values.push_back(r_mm >= kRadius_mm            ? outside_HU
                               : r_mm > kRadius_mm - kRim_mm ? rim_HU
                                                             : inside_HU);
      }
    }
    means.add(static_cast<std::size_t>(z), image);
  }
  means.finish();
  FadingBall out{find_soft_regions(means, threshold_HU), ball.size()};
  for (const std::size_t block : ball) {
    out.missed += out.soft.limit_HU[block] == 0 ? 1 : 0;
    out.highest_limit_HU = std::max(out.highest_limit_HU, out.soft.limit_HU[block]);
  }
  return out;
}

// The search of a region is confined to a box around its core, which must hold all that is near it.
TEST(SoftRegions, AFadingBallIsSoftUpToItsSurface) {
  const FadingBall ball = fading_ball(330, 270, 40, 226);
  EXPECT_EQ(ball.soft.count, 1);
  EXPECT_EQ(ball.missed, 0U) << "of " << ball.blocks;
  EXPECT_NEAR(ball.highest_limit_HU, 430, 10);
}

TEST(SoftRegions, ALimitIsNeverNegative) {
  for (const float inside_HU : {-100.0F, -120.0F, -290.0F}) {
    const FadingBall ball = fading_ball(inside_HU, inside_HU - 30, -1000, -300);
    EXPECT_EQ(ball.soft.count, 1) << inside_HU;
    EXPECT_EQ(ball.missed, 0U) << inside_HU << ", of " << ball.blocks;
    EXPECT_EQ(ball.highest_limit_HU, 1) << inside_HU;
  }
}

}  // namespace
}  // namespace trocar::pipeline
