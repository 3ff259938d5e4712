// SPDX-License-Identifier: Apache-2.0
// The bone volume of a scene, for one tool: its slabs, the sheet that each slab belongs to, and the resistance of each to
// the tool. If slices are at most kMaxSlabGap_m apart, or belong to the scene's `body`, their slabs extend half-way to
// their neighbours. Any other slice is a slab of thickness 0.
//
// Contract (tests/runtime/bone_cutting/material/bone_volume_test.cpp):
//  1. In a bone volume, the slabs of neighbouring slices meet half-way, whatever their distance. The first slab extends as
//     far above its slice as below it, and so does the last one. Next to slices without material, a slab whose slice has
//     no neighbour on either side extends by half the volume's smallest spacing, and no slab fills the gap.
//  2. For a tissue with CutTissue, the values are those of tool_in_tissue.h. A tissue without CutTissue states the forces
//     on the scene's tool. Its threshold and stiffness hold for the tip as they are, and the pressures that follow from
//     them also act sideways over the tool's width.
//  3. A cortical shell lies where the tool enters the bone and where it leaves it. Over the thickness `shell_m` from these
//     points, slabs have the shell's strength. Each slab is divided beforehand at the depths at which a shell can end, so
//     that slabs never change.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "formats/session/scene.h"
#include "runtime/bone_cutting/law/cutting_law.h"
#include "runtime/bone_cutting/material/bone_strength.h"
#include "runtime/bone_cutting/material/tool_in_tissue.h"
#include "runtime/contact/sheet.h"
#include "runtime/contact/tool.h"

namespace trocar::runtime {

inline constexpr double kMaxSlabGap_m = 3e-3;
inline constexpr double kSlabGapRounding_m = 1e-9;
/// Number of holes that a session remembers.
inline constexpr std::size_t kMaxRememberedHoles = 32;

/// A sheet's resistance to the tool at full coverage.
struct BoneSheet {
  double nominal_N = 0;     ///< strength of the front at the slice's mean HU
  double shell_factor = 1;  ///< strength of the shell over that of the bone under the tool
  /// Thickness of the shell, and the radius within which nothing supports it. Radius 0: bone supports the shell.
  double shell_m = 0, shell_free_radius_m = 0;
  double tip_N_per_m = 0;
  /// Law that gives the strength from HU. Null: the material's strength holds everywhere.
  const BoneLaw* law = nullptr;
  HuCalibration calibration;
  double pressure_over_yield = 1;
  /// Friction of the shaft per embedded length and per pascal of the bone's strength under the tool, at full coverage.
  double friction_N_per_m_Pa = 0;
  CutMaterial material;            ///< values at the slice's mean HU
  bool is_of_the_tool = false;     ///< nominal_N holds for the scene's tool, whatever its shape
  int first_slab = 0, slabs = 0;   ///< the sheet's slabs, from the top
  double top_m = 0, bottom_m = 0;  ///< depths
  bool meets_above = false, meets_below = false;  ///< the neighbour is adjacent, without a gap

  double pressure_Pa(
      double hu) const noexcept;  ///< pressure under a flat tip; `law` must not be null
  /// Friction of the shaft per embedded length in bone of this HU. `nominal_N_per_m`: the same in bone of the
  /// slice's mean HU.
  double friction_N_per_m(double hu, double nominal_N_per_m) const noexcept;
  /// Strength of the shell in bone of this HU, in which the front's strength is `strength_N`. It is at most that
  /// of a thin wall.
  double shell_N(const ToolShape& shape, double hu, double strength_N) const noexcept;
  /// Strength of the front in bone of this HU. `slice_push`: as for tool_in_tissue().
  double strength_N(const ToolShape& shape, double hu, double slice_push = 0) const noexcept;
  /// Moment that turns the tool at this slice-push ratio (ToolInTissue::twist_Nm).
  double twist_Nm(const ToolShape& shape, double slice_push) const noexcept;
};

struct BoneVolume {
  Tool tool;
  double radius_m = 0;  ///< radius of the disc with the area of the tool's outline
  ToolShape shape;
  bool twists = false;     ///< SceneForceLaw::twist
  CuttingOptions options;  ///< the coupling is the scene's, before the device limits it
  double shell_m = 0;
  std::vector<BoneSheet> sheets;   ///< same order as the session's: topmost first
  std::vector<CuttingSlab> slabs;  ///< slabs with their nominal strengths
  std::vector<int> sheet_of_slab;
  std::vector<SoftLayer> layers;  ///< uppermost first
  /// Largest stiffness that the tool can meet: along its axis that of tip and friction, across it that of the walls.
  double along_N_per_m = 0, across_N_per_m = 0;
  double viscous_N_s_per_m = 0;  ///< viscous friction along the shaft, in all slabs
};

/// The shape of a scene's tool. Refused: a kind that does not exist, an inner radius that is too large.
Result<ToolShape> tool_shape(const SceneTool& tool);

/// Computes the forces of the layers whose toughness is given. Refused: as for tool_shape().
Result<void> resolve_layers(Scene& scene);

/// `sheets`: the result of place_slices() for a scene with the force law `cutting`, whose layers are resolved. Refused: a
/// bone law that does not exist, has no strength or is for another kind of density; a strength that follows from HU, for a
/// slice without HU; a shell without support whose tissue has no bone law; a layer that is not resolved.
Result<BoneVolume> make_bone_volume(const Scene& scene, std::span<const Sheet* const> sheets);

}  // namespace trocar::runtime
