// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/bone/bone_strength.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace trocar::runtime {
namespace {

constexpr std::string_view kKopperdahl =
    "D. Kopperdahl, E. Morgan, T. Keaveny, J. Orthop. Res. 20 (2002), human vertebrae";

constexpr std::array<BoneLaw, 4> kLaws{{
    {.name = "kopperdahl-linear",
     .source = kKopperdahl,
     .modulus_MPa = {-34.7, 3230, 1},
     .strength_MPa = DensityLaw{-0.75, 24.9, 1},
     .kind = DensityKind::kQct},
    {.name = "kopperdahl-power",
     .source = kKopperdahl,
     .modulus_MPa = {0, 2980, 1.05},
     .strength_MPa = DensityLaw{0, 37.4, 1.39},
     .kind = DensityKind::kQct},
    {.name = "morgan",
     .source = "E. Morgan, H. Bayraktar, T. Keaveny, J. Biomech. 36 (2003), human vertebrae",
     .modulus_MPa = {0, 4730, 1.56},
     .strength_MPa = std::nullopt,
     .kind = DensityKind::kApparent},
    {.name = "keller",
     .source = "T. Keller, J. Biomech. 27 (1994), human vertebrae",
     .modulus_MPa = {0, 1890, 1.92},
     .strength_MPa = std::nullopt,
     .kind = DensityKind::kAsh},
}};

}  // namespace

std::string_view name_of(DensityKind kind) noexcept {
  constexpr std::string_view kNames[] = {"QCT mineral density", "ash density", "apparent density"};
  return kNames[static_cast<std::size_t>(kind)];
}

double density_of(const HuCalibration& calibration, double HU) noexcept {
  return std::max(0.0, calibration.at_0_HU + calibration.per_HU * HU);
}

std::span<const BoneLaw> bone_laws() noexcept {
  return kLaws;
}

const BoneLaw* find_bone_law(std::string_view name) noexcept {
  const auto at = std::find_if(kLaws.begin(), kLaws.end(),
                               [&](const BoneLaw& law) { return law.name == name; });
  return at == kLaws.end() ? nullptr : &*at;
}

double value_of(const DensityLaw& law, double density) noexcept {
  if (!(density > 0)) return std::max(law.constant, 0.0);
  return std::max(law.constant + law.factor * std::pow(density, law.exponent), 0.0);
}

}  // namespace trocar::runtime
