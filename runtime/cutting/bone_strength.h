// SPDX-License-Identifier: Apache-2.0
// The strength of bone from CT: HU to density by a linear calibration, density to modulus and
// strength by published laws, chosen by name. Densities in g/cm^3, moduli and strengths in MPa.
//
// A law holds for the density that its authors measured, and they differ. In one bone the mineral
// density that quantitative CT reads against a phantom of K2HPO4 is about the ash density (mineral
// mass over volume), and that is 0.6 of the apparent density (wet mass without marrow over volume).
// A density says of which kind it is; a law takes no other, unless by a named conversion.
//
// What was checked of the laws, and where (none of the papers' full texts):
//  - Kopperdahl 2002: the title names quantitative CT. The linear coefficients stand in two public
//    programs for vertebrae, of which one feeds K2HPO4-equivalent density and one calls it
//    apparent; the power form stands in the first of them. Taken as QCT density.
//  - Morgan 2003: the abstract says apparent density, and exponents from 1.49 to 2.18 by site; the
//    vertebra's coefficients stand in the same two programs.
//  - Keller 1994: one public program has the coefficients, for ash density of the spine, and others
//    use his femur law with ash density. Taken as ash density; not verified in the paper.
//
// Contract (tests/runtime/cutting/bone_strength_test.cpp):
//  1. The values of the published formulas; never negative: a linear law's are 0 below its root.
//  2. estimate() has no value where density and law differ in kind and no conversion is allowed or
//     known; what was converted, it says.
#pragma once

#include <optional>
#include <span>
#include <string_view>

namespace trocar::runtime {

enum class DensityKind { kQct, kAsh, kApparent };
std::string_view name_of(DensityKind kind) noexcept;

/// density = at_0_HU + per_HU * HU. The default is what scanners at 120 kV come to about (0.8
/// mg/cm^3 of K2HPO4 a HU), not a measurement: a scene that uses it says that it is assumed.
struct HuCalibration {
  double per_HU = 8e-4, at_0_HU = 0;  ///< g/cm^3
  DensityKind kind = DensityKind::kQct;
  bool is_assumed = true;
};
/// At least 0; of the calibration's kind.
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

/// to = factor * from
struct DensityConversion {
  DensityKind from = DensityKind::kQct, to = DensityKind::kQct;
  double factor = 1;
  std::string_view source;
};
/// Null: none is known. From QCT to the others there is none here: published ones hold for one
/// phantom and scanner.
const DensityConversion* find_conversion(DensityKind from, DensityKind to) noexcept;

/// By a law, from HU.
struct BoneEstimate {
  double density = 0;  ///< g/cm^3, of the law's kind
  DensityKind kind = DensityKind::kQct;
  double modulus_MPa = 0;
  std::optional<double> strength_MPa;             ///< none: the law has none
  const DensityConversion* conversion = nullptr;  ///< null: none was needed
};
/// Contract 2.
std::optional<BoneEstimate> estimate(const BoneLaw& law, const HuCalibration& calibration,
                                     double HU, bool may_convert = false) noexcept;

/// What a tool's front meets: the strength over its area, and the tearing of its outline.
inline double front_strength_N(double strength_MPa, double area_m2, double tearing_N_per_m,
                               double perimeter_m) noexcept {
  return strength_MPa * 1e6 * area_m2 + tearing_N_per_m * perimeter_m;
}

}  // namespace trocar::runtime
