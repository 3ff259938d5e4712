// SPDX-License-Identifier: Apache-2.0
// Values for scenes of known interventions, such as one with an epidural needle. The values of one
// intervention are called a procedure: the tool, the soft layers and the resistance of the bone.
// Most values have a range, and a source or the word "assumed".
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "formats/base/result.h"
#include "formats/session/scene.h"

namespace trocar {

/// Selects one of the three values of each Range of a procedure: Range::low, Range::median or
/// Range::high. A scene gets the selected values; the same choice applies to the tool, the layers
/// and the bone. The user makes the choice by the option `--strength` of trocar-run, or by
/// `strength` in the scene's `procedure`.
enum class Strength : std::uint8_t { kLow, kMedian, kHigh };
const char* to_string(Strength strength) noexcept;

/// Reads "low", "median" or "high". Returns std::nullopt for any other text.
std::optional<Strength> strength_from_string(std::string_view text) noexcept;

/// A value with its range: 5th percentile, median and 95th percentile. Larger values give larger
/// forces.
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
  double gap_mm = 0;  ///< distance from the bottom of this layer to the next layer or the bone
};

/// The bone (CutTissue). Its strength follows from HU by the law `kopperdahl-power`.
struct ProcedureBone {
  Range pressure_over_yield, tearing_N_per_m, friction_coefficient, foundation_N_per_mm3,
      lateral_strength_MPa;
};

struct Procedure {
  std::string_view name, title;
  // The tool (SceneTool).
  std::string_view kind;
  Range diameter_mm;
  Range bore_mm{};  ///< 0: the tool is not hollow
  Range half_angle_deg;
  ProcedureBone bone;
  bool twists = false;                          ///< SceneForceLaw::twist
  std::span<const ProcedureLayer> layers = {};  ///< uppermost first
};

std::span<const Procedure> procedures() noexcept;
/// The procedure of this name, or null.
const Procedure* find_procedure(std::string_view name) noexcept;
/// All names, separated by commas.
std::string procedure_names();

/// Replaces three parts of a scene by those of the procedure: the shape of the tool, Scene::tissue
/// and the soft layers. Sets the force law `cutting` and SceneForceLaw::twist. The layers lie over
/// the highest slice: the bottom of the lowest layer is this layer's gap_mm (which may be 0) above
/// the slice. Errors: kRefused if the path of the scene's simulated hand begins below the top of
/// the layers, or if the scene has named tissues (Scene::tissues), because a procedure does not
/// replace these tissues. The message does not contain the scene's name.
Result<void> apply_procedure(const Procedure& procedure, Strength strength, Scene& scene);

/// Returns a table of all values with their ranges and sources, as lines of text.
std::string explain(const Procedure& procedure);

}  // namespace trocar
