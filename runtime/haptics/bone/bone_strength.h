// SPDX-License-Identifier: Apache-2.0
// The strength of bone from CT. A linear calibration maps HU to density, and published laws, chosen by name,
// map density to modulus and strength. Densities are in g/cm^3, moduli and strengths in MPa.
//
// Each law holds for the kind of density that its authors measured, and these kinds differ.
// Quantitative CT (QCT) measures a mineral density against a phantom of K2HPO4. This density is
// about equal to the ash density of the same bone, which is the mineral mass divided by the volume.
// The ash density is 0.6 times the apparent density, which is the wet mass without marrow divided
// by the volume. Here every density states its kind, and a session refuses a calibration whose kind
// is not that of its law.
//
// Sources of the laws, and how they were checked (never against the papers' full texts):
//  - Kopperdahl 2002: the title names quantitative CT. The coefficients of the linear law appear in
//    two public programs for vertebrae. One program uses them with K2HPO4-equivalent density, and
//    the other one calls the density apparent. The power law appears in the first program. Trocar
//    uses both laws with QCT density.
//  - Morgan 2003: the abstract names apparent density, and exponents from 1.49 to 2.18 that depend
//    on the anatomical site. The coefficients for vertebrae appear in the same two programs.
//  - Keller 1994: one public program has the coefficients for ash density of the spine, and other
//    programs use Keller's law for the femur with ash density. Trocar uses the law with ash
//    density.
//
// Contract:
// Values are those of the published formulas. If a formula gives less than 0, the value is 0.
#pragma once

#include <optional>
#include <span>
#include <string_view>

namespace trocar::runtime {

enum class DensityKind { kQct, kAsh, kApparent };
std::string_view name_of(DensityKind kind) noexcept;

/// density = at_0_HU + per_HU * HU. The default is a typical value for scanners at 120 kV (0.8
/// mg/cm^3 of K2HPO4 per HU), not a measurement. `is_assumed` is true if no calibration was given,
/// so that the default is used.
struct HuCalibration {
  double per_HU = 8e-4, at_0_HU = 0;  ///< g/cm^3 per HU, g/cm^3
  DensityKind kind = DensityKind::kQct;
  bool is_assumed = true;
};
/// Returns the density, which is at least 0. Its kind is the one that the calibration names.
double density_of(const HuCalibration& calibration, double HU) noexcept;

/// value = constant + factor * density^exponent
struct DensityLaw {
  double constant = 0, factor = 0, exponent = 1;
};

struct BoneLaw {
  std::string_view name, source;
  DensityLaw modulus_MPa;
  std::optional<DensityLaw>
      strength_MPa;  ///< yield strength in compression; none: the source gives no strength
  DensityKind kind = DensityKind::kQct;
};

/// All laws.
std::span<const BoneLaw> bone_laws() noexcept;
/// The law of that name, or null.
const BoneLaw* find_bone_law(std::string_view name) noexcept;

/// Returns the law's value at a density in g/cm^3. The value is at least 0.
double value_of(const DensityLaw& law, double density) noexcept;

/// Ash density over apparent density (E. Schileo et al., J. Biomech. 41, 2008). There is no conversion
/// from or to QCT density, because each published one holds for one phantom and scanner only.
inline constexpr double kAshOverApparent = 0.598;

}  // namespace trocar::runtime
