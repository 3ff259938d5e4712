// SPDX-License-Identifier: Apache-2.0
// The strength of bone from CT: HU to density by a linear calibration, density to modulus and
// strength by published laws, chosen by name. Densities in g/cm^3, moduli and strengths in MPa.
//
// A law holds for the density that its authors measured, and they differ: the mineral density that
// quantitative CT reads against a phantom of K2HPO4 is less than the apparent density (wet mass
// over volume, without marrow) of the same bone. A calibration says which density it gives; it may
// be used with laws of that density only.
//
// Contract (tests/runtime/cutting/bone_strength_test.cpp): the values of the published formulas;
// never negative: a linear law's are 0 below its root.
#pragma once

#include <optional>
#include <span>
#include <string_view>

namespace trocar::runtime {

enum class DensityKind { kQct, kApparent };
std::string_view name_of(DensityKind kind) noexcept;

/// density = at_0_HU + per_HU * HU. The default is what scanners at 120 kV come to about (0.8
/// mg/cm^3 of K2HPO4 a HU), not a measurement: a scene that uses it says that it is assumed.
struct HuCalibration {
  double per_HU = 8e-4, at_0_HU = 0;  ///< g/cm^3
  DensityKind kind = DensityKind::kQct;
  bool is_assumed = true;
};
/// At least 0.
double density_of(const HuCalibration& calibration, double HU) noexcept;

/// value = constant + factor * density^exponent
struct DensityLaw {
  double constant = 0, factor = 0, exponent = 1;
};

struct BoneLaw {
  std::string_view name, source;
  DensityLaw modulus_MPa;
  std::optional<DensityLaw> strength_MPa;  ///< at yield in compression; none: the source has none
  DensityKind kind = DensityKind::kQct;
};

/// All that there are.
std::span<const BoneLaw> bone_laws() noexcept;
/// By name; null: none.
const BoneLaw* find_bone_law(std::string_view name) noexcept;

/// Of a density in g/cm^3; at least 0.
double value_of(const DensityLaw& law, double density) noexcept;

/// What a tool's front meets: the strength over its area, and the tearing of its outline.
inline double front_strength_N(double strength_MPa, double area_m2, double tearing_N_per_m,
                               double perimeter_m) noexcept {
  return strength_MPa * 1e6 * area_m2 + tearing_N_per_m * perimeter_m;
}

}  // namespace trocar::runtime
