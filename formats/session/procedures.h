// SPDX-License-Identifier: Apache-2.0
// Procedures: the tool, the soft layers and the resistance of bone for interventions that trainers know, with the
// published range of each value and where it comes from.
// Tests: tests/formats/session/procedures_test.cpp, tests/runtime/bone_cutting/material/procedure_forces_test.cpp
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "formats/base/result.h"
#include "formats/session/scene.h"

namespace trocar {

/// The part of each range that a scene uses: its 5th percentile, its median, or its 95th percentile.
enum class Strength : std::uint8_t { kLow, kMedian, kHigh };

/// "low", "median" or "high".
std::optional<Strength> strength_from_string(std::string_view text) noexcept;

/// A value with its range. Larger values give larger forces.
struct Range {
  double low, median, high;
  std::string_view source;  ///< begins with "assumed" if no source was found

  constexpr double at(Strength strength) const noexcept {
    return strength == Strength::kLow ? low : strength == Strength::kHigh ? high : median;
  }
};

/// Soft tissue over the bone (SceneLayer).
struct ProcedureLayer {
  std::string_view name;
  Range thickness_mm, toughness_J_per_m2, stiffness_N_per_m, stiffening_N_per_m2, friction_N_per_m;
  double gap_mm = 0;  ///< distance to the layer below
};

struct Procedure {
  std::string_view name, title;
  // The tool (SceneTool).
  std::string_view kind;
  Range diameter_mm, bore_mm, half_angle_deg;
  // The bone (CutTissue); its strength follows from HU by the law `kopperdahl-power`.
  Range pressure_over_yield, tearing_N_per_m, friction_coefficient, foundation_N_per_mm3,
      lateral_strength_MPa;
  bool twists = false;                     ///< SceneForceLaw::twist
  std::span<const ProcedureLayer> layers;  ///< uppermost first
};

std::span<const Procedure> procedures() noexcept;
/// Null: there is none of this name.
const Procedure* find_procedure(std::string_view name) noexcept;
/// All names, separated by commas.
std::string procedure_names();

/// Replaces the shape of the scene's tool, its tissue and its layers, and sets the force law `cutting`. The lowest
/// layer ends at the highest slice. Errors: (refused, without the scene's name) the hand begins within the layers; the
/// scene has `tissues`, which would have their own resistance.
Result<void> apply_procedure(const Procedure& procedure, Strength strength, Scene& scene);

/// A table of all values with their ranges and sources, as lines of text.
std::string explain(const Procedure& procedure);

}  // namespace trocar
