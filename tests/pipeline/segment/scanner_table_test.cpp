// SPDX-License-Identifier: GPL-3.0-or-later
// Tables and patients as phantoms: what is left out, and that nothing of a patient is.
#include "pipeline/segment/scanner_table.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>

#include "pipeline/segment/solid_bone.h"
#include "tests/support/memory_stack.h"

namespace trocar::pipeline {
namespace {

constexpr double kAir = -1000, kFoam = -920, kSoftTissue = 40, kBone = 700, kShell = 320;

// A thing of the phantom: its HU at a point, or NaN outside. x left, y back, z up, in mm.
using Thing = std::function<double(double x, double y, double z)>;

const double kNothing = std::nan("");

// Slices of 400 x 320 mm, 2 mm pixels and 5 mm apart. The first thing that is at a point gives its
// HU. `frame` gives the patient's axes.
class PhantomStack final : public MemoryStack {
 public:
  explicit PhantomStack(const std::vector<Thing>& things, double noise_HU = 15,
                        const Eigen::Matrix3d& frame = Eigen::Matrix3d::Identity()) {
    std::mt19937_64 random(3);
    std::normal_distribution<double> noise(0, noise_HU);
    for (int k = 0; k < 20; ++k) {
      images.push_back(image_of(200, 160, [&](int u, int v) {
        double value = kAir;
        for (const Thing& thing : things) {
          const double hu = thing(2 * u - 200, 2 * v - 160, 5 * k - 50);
          if (std::isnan(hu)) continue;
          value = hu;
          break;
        }
        return value + noise(random);
      }));
      SlicePlane plane{2, 2, Eigen::Affine3d(frame), 5.0 * k};
      plane.T_lps_plane.translation() = frame.col(2) * (5.0 * k);
      planes.push_back(plane);
    }
  }
};

Thing ellipse(double x0, double y0, double a, double b, double hu) {
  return [=](double x, double y, double) {
    return std::hypot((x - x0) / a, (y - y0) / b) < 1 ? hu : kNothing;
  };
}

Thing box(double x0, double x1, double y0, double y1, double hu) {
  return [=](double x, double y, double) {
    return x >= x0 && x < x1 && y >= y0 && y < y1 ? hu : kNothing;
  };
}

Thing within(double z0, double z1, const Thing& thing) {
  return
      [=](double x, double y, double z) { return z >= z0 && z < z1 ? thing(x, y, z) : kNothing; };
}

// A trunk with a spine, ribs and a hip of metal.
std::vector<Thing> trunk(double y = 0) {
  return {ellipse(60, y, 8, 8, 3000), ellipse(0, y + 50, 20, 15, kBone),
          [y](double x, double at, double z) {
            const double r = std::hypot(x / 120, (at - y) / 80);
            return r > 0.9 && r < 0.95 && std::fmod(z + 60, 20) < 10 ? kBone : kNothing;
          },
          ellipse(0, y, 135, 90, kSoftTissue)};
}

// Two plates of carbon with foam between them, 400 mm wide, 40 mm high, and rails at its sides.
std::vector<Thing> table(double y) {
  return {box(-180, 180, y, y + 4, kShell), box(-180, 180, y + 36, y + 40, kShell),
          box(-180, -176, y, y + 40, kShell), box(176, 180, y, y + 40, kShell),
          box(-180, 180, y, y + 40, kFoam)};
}

std::vector<Thing> operator+(std::vector<Thing> a, const std::vector<Thing>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

struct Found {
  std::size_t table = 0, removed_table = 0, patient = 0, removed_patient = 0;
  std::string codes;
};

// Counts the pixels of the table and of the patient, and those that are left out.
Found found_in(const std::vector<Thing>& patient, const std::vector<Thing>& table,
               double threshold = 226, double noise_HU = 15) {
  const PhantomStack all(patient + table, noise_HU), alone(patient, 0);
  const auto found = ScannerTable::find(all, Threshold{threshold});
  Found out;
  MaterialOptions options;
  options.segmentation = Threshold{threshold};
  options.table = found ? &*found : nullptr;
  for (int k = 0; k < all.size(); ++k) {
    const Image image = *all.read(k), own = *alone.read(k);
    const Field field = slice_field(all, k, options, image).field;
    for (std::size_t i = 0; i < image.values.size(); ++i) {
      if (image.values[i] < static_cast<float>(threshold)) {
        EXPECT_EQ(field.image.values[i], image.values[i]);
        continue;
      }
      const bool is_removed = field.image.values[i] < field.iso;
      const bool is_patient = own.values[i] >= -900;
      ++(is_patient ? out.patient : out.table);
      if (is_removed) ++(is_patient ? out.removed_patient : out.removed_table);
    }
  }
  if (found)
    for (const Warning& warning : found->warnings())
      out.codes += warning.code + " ";
  return out;
}

void expect_removed(const Found& found) {
  EXPECT_GT(found.table, 1000U);
  EXPECT_GE(static_cast<double>(found.removed_table), 0.995 * static_cast<double>(found.table));
  EXPECT_GT(found.patient, 1000U);
  EXPECT_EQ(found.removed_patient, 0U);
  EXPECT_EQ(found.codes, "table_removed ");
}

void expect_kept(const Found& found, const std::string& codes = "") {
  EXPECT_EQ(found.removed_table, 0U);
  EXPECT_EQ(found.removed_patient, 0U);
  EXPECT_EQ(found.codes, codes);
}

TEST(ScannerTable, ATableIsLeftOutWhetherOrNotItTouchesTheSkin) {
  for (const double noise_HU : {0.0, 15.0, 50.0})
    expect_removed(found_in(trunk(), table(105), 226, noise_HU));
  expect_removed(found_in(trunk(), table(90)));  // touches the skin
}

TEST(ScannerTable, ATableOnAnySideIsLeftOut) {
  expect_removed(found_in(trunk(20), table(-125)));  // prone in an image of the supine patient
  const auto turned = [](const std::vector<Thing>& things) {
    std::vector<Thing> out;
    out.reserve(things.size());
    for (const Thing& thing : things)
      out.push_back([thing](double x, double y, double z) { return thing(y, x, z); });
    return out;
  };
  expect_removed(found_in(turned(trunk(20)), turned(table(125))));
}

TEST(ScannerTable, AThickPlateAndACurvedShellAreLeftOut) {
  expect_removed(found_in(trunk(), {box(-200, 200, 105, 130, 260)}, 226, 5));
  const Thing shell = [](double x, double y, double) {
    const double r = std::hypot(x / 190, (y - 20) / 110);
    return r > 0.97 && r < 1 && y > 40 ? kShell : kNothing;
  };
  expect_removed(found_in(trunk(), {shell}));
}

TEST(ScannerTable, AHeadHolderIsLeftOut) {
  const std::vector<Thing> head = {[](double x, double y, double z) {
                                     const double r = std::hypot(x / 72, y / 92, z / 110);
                                     return r > 0.86 && r < 0.95 ? kBone : kNothing;
                                   },
                                   ellipse(0, 0, 75, 95, kSoftTissue)};
  const Thing holder = [](double x, double y, double) {
    const double r = std::hypot(x / 100, y / 118);
    return r > 0.96 && r < 1 && y > 0 ? kShell : kNothing;
  };
  expect_removed(found_in(head, {holder}));
}

TEST(ScannerTable, ArmsLegsAndHandsStay) {
  const Thing arm_bone = ellipse(160, 20, 9, 9, kBone), arm = ellipse(160, 20, 28, 28, kSoftTissue);
  const Thing other_bone = ellipse(-160, 60, 9, 9, kBone),
              other = ellipse(-160, 60, 28, 28, kSoftTissue);
  expect_removed(found_in(std::vector{arm_bone, arm, other_bone, other} + trunk(), table(105)));
  expect_kept(found_in(std::vector{arm_bone, arm, other_bone, other} + trunk(), {}));
  const std::vector<Thing> legs = {
      ellipse(90, 0, 14, 14, kBone), ellipse(90, 0, 70, 70, kSoftTissue),
      ellipse(-90, 0, 14, 14, kBone), ellipse(-90, 0, 70, 70, kSoftTissue)};
  expect_removed(found_in(legs, table(100)));
  expect_kept(found_in(legs, {}));
  // A forearm and fingers across the belly, in all slices.
  const std::vector<Thing> hand = {box(-100, 100, -112, -106, kBone),
                                   box(-110, 110, -118, -100, kSoftTissue)};
  expect_kept(found_in(hand + trunk(), {}));
  expect_removed(found_in(hand + trunk(), table(105)));
}

TEST(ScannerTable, WithoutALargeBodyNothingIsLeftOut) {
  const std::vector<Thing> skull = {[](double x, double y, double) {
    const double r = std::hypot(x / 70, y / 90);
    return r > 0.94 && r < 1 ? kBone : kNothing;
  }};
  expect_kept(found_in(skull, table(105)));
}

TEST(ScannerTable, CushionsStay) {
  expect_kept(found_in(trunk(), {box(-180, 180, 95, 125, -500)}));
}

TEST(ScannerTable, ATableConnectedWithBoneStaysAndIsNamed) {
  const std::vector<Thing> screw = {box(-4, 4, 50, 106, 2000)};
  expect_kept(found_in(screw + trunk(), table(105)), "table_connected ");
}

TEST(ScannerTable, APlateInAFewSlicesIsNoTable) {
  expect_kept(found_in(trunk(), {within(-50, 0, box(-180, 180, 105, 109, kShell))}));
}

// Each place of this plate's cross-section is in three or four of ten samples.
TEST(ScannerTable, APlateThatLiesElsewhereInEachSliceIsNoTable) {
  const Thing plate = [](double x, double y, double z) {
    const double from = 98 + 2 * (z + 50) / 5;
    return std::abs(x) < 180 && y >= from && y < from + 14 ? kShell : kNothing;
  };
  expect_kept(found_in(trunk(), {plate}));
}

TEST(ScannerTable, APlateThatIsNarrowerThanATableStays) {
  expect_kept(found_in(trunk(), {box(-60, 60, 105, 109, kShell)}));
  expect_removed(found_in(trunk(), {box(-90, 90, 105, 109, kShell)}));
}

TEST(ScannerTable, ACropRemovesTheSamePixels) {
  const PhantomStack stack(trunk() + table(105));
  const auto found = ScannerTable::find(stack, Threshold{226});
  ASSERT_TRUE(found);
  MaterialOptions options;
  options.segmentation = Threshold{226};
  options.table = &*found;
  const Image image = *stack.read(7);
  const Image whole = slice_field(stack, 7, options, image).field.image;
  constexpr Crop kCrop{30, 169, 40, 149};
  options.crop = kCrop;
  Image cropped{kCrop.x1 - kCrop.x0 + 1, kCrop.y1 - kCrop.y0 + 1, {}};
  std::size_t removed = 0;
  std::vector<float> expected;
  for (int y = kCrop.y0; y <= kCrop.y1; ++y) {
    for (int x = kCrop.x0; x <= kCrop.x1; ++x) {
      cropped.values.push_back(image.at(x, y));
      expected.push_back(whole.at(x, y));
      removed += whole.at(x, y) != image.at(x, y) ? 1 : 0;
    }
  }
  EXPECT_GT(removed, 100U);
  EXPECT_EQ(slice_field(stack, 7, options, cropped).field.image.values, expected);
}

TEST(ScannerTable, OnlyAThresholdOfAxialSlicesIsSearched) {
  const std::vector<Thing> things = trunk() + table(105);
  EXPECT_TRUE(ScannerTable::find(PhantomStack(things), Threshold{226}));
  EXPECT_FALSE(ScannerTable::find(PhantomStack(things), Labels{{1}}));
  Eigen::Matrix3d sagittal;
  sagittal << 0, 0, 1, 1, 0, 0, 0, 1, 0;
  EXPECT_FALSE(ScannerTable::find(PhantomStack(things, 15, sagittal), Threshold{226}));
}

TEST(ScannerTable, SolidBoneIsMadeWithoutIt) {
  const PhantomStack stack(trunk() + table(105));
  const auto table = ScannerTable::find(stack, Threshold{226});
  ASSERT_TRUE(table);
  SolidOptions options;
  options.fill_mm2 = 20'000;  // as large as the foam between the plates
  const auto solid = SolidBone::make(stack, Threshold{226}, SliceAxis::kAxial, options, &*table);
  ASSERT_TRUE(solid);
  for (int k = 0; k < stack.size(); ++k)
    for (int y = (105 + 160) / 2; y < stack.height(); ++y)
      for (int x = 0; x < stack.width(); ++x)
        EXPECT_FALSE(solid->inside(k, x, y));
}

}  // namespace
}  // namespace trocar::pipeline
