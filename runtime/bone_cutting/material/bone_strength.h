// SPDX-License-Identifier: Apache-2.0
// The strength of bone from CT: HU to density by a linear calibration, and density to modulus and strength by
// published laws, chosen by name. Densities in g/cm^3, moduli and strengths in MPa.
//
// A law holds for the density that its authors measured, and these differ. In the same bone the mineral
// density that quantitative CT measures against a phantom of K2HPO4 is about the ash density (mineral mass
// over volume), which is 0.6 of the apparent density (wet mass without marrow over volume). A density states
// its kind, and a law accepts no other kind, unless by a named conversion.
//
// Sources of the laws, and how they were checked (none in the papers' full texts):
//  - Kopperdahl 2002: the title names quantitative CT. The linear coefficients appear in two public programs
//    for vertebrae; one feeds K2HPO4-equivalent density, the other calls it apparent. The power form appears
//    in the first of them. Used here as QCT density.
//  - Morgan 2003: the abstract says apparent density, and exponents from 1.49 to 2.18 by site. The
//    vertebra's coefficients appear in the same two programs.
//  - Keller 1994: one public program has the coefficients, for ash density of the spine, and others use his
//    femur law with ash density. Used here as ash density; not verified in the paper.
//
// Contract (tests/runtime/bone_cutting/material/bone_strength_test.cpp):
//  1. Values are those of the published formulas, never negative: a linear law is 0 below its root.
//  2. estimate() returns no value if density and law differ in kind and no conversion is allowed or known. A
//     result names the conversion that was applied.
#pragma once

#include <optional>
#include <span>
#include <string_view>

namespace trocar::runtime {

enum class DensityKind { kQct, kAsh, kApparent };
std::string_view name_of(DensityKind kind) noexcept;

/// density = at_0_HU + per_HU * HU. The default is typical of scanners at 120 kV (0.8
/// mg/cm^3 of K2HPO4 per HU). It is not a measurement, and results that use it are marked as assumed.
struct HuCalibration {
  double per_HU = 8e-4, at_0_HU = 0;  ///< g/cm^3
  DensityKind kind = DensityKind::kQct;
  bool is_assumed = true;
};
/// Density of the calibration's kind, at least 0.
double density_of(const HuCalibration& calibration, double HU) noexcept;

/// value = constant + factor * density^exponent
struct DensityLaw {
  double constant = 0, factor = 0, exponent = 1;
};

struct BoneLaw {
  std::string_view name, source;
  DensityLaw modulus_MPa;
  std::optional<DensityLaw>
      strength_MPa;  ///< yield strength in compression; none: the source gives none
  DensityKind kind = DensityKind::kQct;
};

/// All laws.
std::span<const BoneLaw> bone_laws() noexcept;
/// The law of that name, or null.
const BoneLaw* find_bone_law(std::string_view name) noexcept;

/// The law's value at a density in g/cm^3, at least 0.
double value_of(const DensityLaw& law, double density) noexcept;

/// to = factor * from
struct DensityConversion {
  DensityKind from = DensityKind::kQct, to = DensityKind::kQct;
  double factor = 1;
  std::string_view source;
};
/// Null: none is known. There is none from QCT density, because published ones hold for one phantom and
/// scanner.
const DensityConversion* find_conversion(DensityKind from, DensityKind to) noexcept;

/// Modulus and strength from HU.
struct BoneEstimate {
  double density = 0;  ///< density of the law's kind, g/cm^3
  DensityKind kind = DensityKind::kQct;
  double modulus_MPa = 0;
  std::optional<double> strength_MPa;             ///< none: the law gives none
  const DensityConversion* conversion = nullptr;  ///< null: no conversion was needed
};
/// Applies a law to HU (contract 2).
std::optional<BoneEstimate> estimate(const BoneLaw& law, const HuCalibration& calibration,
                                     double HU, bool may_convert = false) noexcept;

/// Strength of a tool's front: the bone's strength over its area, and the tearing of its outline.
inline double front_strength_N(double strength_MPa, double area_m2, double tearing_N_per_m,
                               double perimeter_m) noexcept {
  return strength_MPa * 1e6 * area_m2 + tearing_N_per_m * perimeter_m;
}

}  // namespace trocar::runtime
