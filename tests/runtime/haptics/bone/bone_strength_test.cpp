// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/bone/bone_strength.h"

#include <gtest/gtest.h>

#include <set>
#include <stdexcept>

namespace trocar::runtime {
namespace {

const BoneLaw& law(std::string_view name) {
  const BoneLaw* found = find_bone_law(name);
  if (found == nullptr) throw std::invalid_argument("no such law");
  return *found;
}

// Computed by hand, with logarithms: 0.2^1.05 = exp(1.05 * -1.6094379) = 0.184536,
// 0.2^1.39 = exp(-2.2371187) = 0.106765, 0.2^1.56 = exp(-2.5107231) = 0.081210,
// 0.2^1.92 = exp(-3.0901208) = 0.045496.
TEST(BoneStrength, PublishedLawsAtOneDensity) {
  constexpr double kRho = 0.2;
  EXPECT_NEAR(value_of(law("kopperdahl-linear").modulus_MPa, kRho), 611.3, 1e-9);
  EXPECT_NEAR(value_of(*law("kopperdahl-linear").strength_MPa, kRho), 4.23, 1e-9);
  EXPECT_NEAR(value_of(law("kopperdahl-power").modulus_MPa, kRho), 549.91, 0.01);
  EXPECT_NEAR(value_of(*law("kopperdahl-power").strength_MPa, kRho), 3.9930, 1e-4);
  EXPECT_NEAR(value_of(law("morgan").modulus_MPa, kRho), 384.12, 0.01);
  EXPECT_NEAR(value_of(law("keller").modulus_MPa, kRho), 85.987, 0.005);
}

TEST(BoneStrength, AtOneGramTheFactorsShow) {
  EXPECT_DOUBLE_EQ(value_of(law("morgan").modulus_MPa, 1), 4730);
  EXPECT_DOUBLE_EQ(value_of(law("keller").modulus_MPa, 1), 1890);
  EXPECT_DOUBLE_EQ(value_of(*law("kopperdahl-linear").strength_MPa, 1), 24.15);
  EXPECT_FALSE(law("morgan").strength_MPa.has_value());
  EXPECT_FALSE(law("keller").strength_MPa.has_value());
}

TEST(BoneStrength, NeverNegative) {
  EXPECT_EQ(value_of(*law("kopperdahl-linear").strength_MPa, 0.03), 0);  // root at 0.0301
  EXPECT_GT(value_of(*law("kopperdahl-linear").strength_MPa, 0.031), 0);
  for (const BoneLaw& each : bone_laws()) {
    EXPECT_EQ(value_of(each.modulus_MPa, 0), 0) << each.name;
    EXPECT_EQ(value_of(each.modulus_MPa, -1), 0) << each.name;
  }
}

TEST(BoneStrength, EachLawSaysWhichDensityItTakes) {
  std::set<std::string_view> names;
  for (const BoneLaw& each : bone_laws()) {
    EXPECT_TRUE(names.insert(each.name).second);
    EXPECT_FALSE(each.source.empty());
  }
  EXPECT_EQ(law("kopperdahl-linear").kind, DensityKind::kQct);
  EXPECT_EQ(law("kopperdahl-power").kind, DensityKind::kQct);
  EXPECT_EQ(law("morgan").kind, DensityKind::kApparent);
  EXPECT_EQ(law("keller").kind, DensityKind::kAsh);
  EXPECT_EQ(name_of(DensityKind::kQct), "QCT mineral density");
  EXPECT_EQ(name_of(DensityKind::kApparent), "apparent density");
  EXPECT_EQ(name_of(DensityKind::kAsh), "ash density");
  EXPECT_EQ(find_bone_law("keler"), nullptr);
}

TEST(BoneStrength, CalibrationIsLinearAndMarked) {
  const HuCalibration assumed;
  EXPECT_TRUE(assumed.is_assumed);
  EXPECT_NEAR(density_of(assumed, 150), 0.12, 1e-12);
  EXPECT_EQ(density_of(assumed, -1000), 0);
  const HuCalibration measured{.per_HU = 7.5e-4, .at_0_HU = -0.006, .is_assumed = false};
  EXPECT_NEAR(density_of(measured, 200), 0.144, 1e-12);
  EXPECT_NEAR(value_of(*law("kopperdahl-linear").strength_MPa, density_of(assumed, 150)), 2.238,
              1e-9);
}

}  // namespace
}  // namespace trocar::runtime
