// SPDX-License-Identifier: Apache-2.0
// The body of bone of a scene, for one tool: which slab belongs to which sheet, and what each
// opposes. Slices at most kOneBody_m apart, or those of the scene's `body`, are slabs that reach
// half-way to their neighbours; any other slice is a shell of no thickness.
//
// Contract (tests/runtime/cutting/body_test.cpp):
//  1. The slabs of neighbours in a body meet half-way, however far apart they are. A body's first
//  slab reaches as far above its
//     slice as below, its last likewise. Where slices without material are between, slabs end at
//     half the body's smallest spacing, and there is none in the gap.
//  2. A tissue with CutTissue is what tool_in_tissue.h makes of it. One without is what the scene's
//     tool feels: threshold and stiffness of the tip as given; the same pressures act sideways over
//     the tool's width.
//  3. A cortical shell lies where the tool comes into bone and where it leaves it: `shell_m` from
//     there the slabs have the shell's strength. A slab is divided for it into parts of constant
//     character, so that slabs never change.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "formats/session/scene.h"
#include "runtime/contact/sheet.h"
#include "runtime/contact/tool.h"
#include "runtime/cutting/bone_strength.h"
#include "runtime/cutting/cutting_law.h"
#include "runtime/cutting/tool_in_tissue.h"

namespace trocar::runtime {

inline constexpr double kOneBody_m = 3e-3;
inline constexpr double kOneBodyRounding_m = 1e-9;
/// Holes that a session remembers.
inline constexpr std::size_t kBodyHoles = 32;

/// What a sheet opposes to the tool with all of the outline over its material.
struct BodySheet {
  double nominal_N = 0;  ///< of the front, at the slice's mean HU
  double shell_N = 0;    ///< of its cortical shell
  double tip_N_per_m = 0;
  /// By HU; null: the material's strength holds throughout.
  const BoneLaw* law = nullptr;
  HuCalibration calibration;
  double pressure_over_yield = 1, friction_coefficient = 0;
  CutMaterial material;            ///< at the slice's mean HU
  bool is_of_the_tool = false;     ///< nominal_N is what the scene's tool feels, whatever its shape
  int first_slab = 0, slabs = 0;   ///< parts of it, from the top
  double top_m = 0, bottom_m = 0;  ///< depth
  bool meets_above = false, meets_below = false;  ///< the neighbour, without a gap

  double pressure_Pa(double hu) const noexcept;  ///< under a flat tip; there must be a law
  /// Of the front at an HU; `slice_push` as in tool_in_tissue().
  double strength_N(const ToolShape& shape, double hu, double slice_push = 0) const noexcept;
};

struct Body {
  Tool tool;
  double radius_m = 0;  ///< of the disc as large as the tool's outline
  ToolShape shape;
  bool twists = false;     ///< ForceLaw::twist
  CuttingOptions options;  ///< the coupling: as the scene says, not yet as the device allows
  double shell_m = 0;
  std::vector<BodySheet> sheets;   ///< as the session's: the topmost first
  std::vector<CuttingSlab> slabs;  ///< nominal
  std::vector<int> sheet_of_slab;
  std::vector<SoftLayer> layers;  ///< from above
  /// The stiffest that the tool can meet: tip and friction along it; walls across it.
  double along_N_per_m = 0, across_N_per_m = 0;
  double viscous_N_s_per_m = 0;  ///< along the shaft, in all slabs
};

/// A tool by its scene. Refused: a kind that does not exist, an inner radius that is too large.
Result<ToolShape> tool_shape(const SceneTool& tool, double outer_radius_m);

/// `sheets` as from place_slices for a scene with the force law `cutting`. Refused: a bone law that
/// does not exist, has no strength or is for another density; a strength by HU of a slice without.
Result<Body> make_body(const Scene& scene, std::span<const Sheet* const> sheets);

}  // namespace trocar::runtime
