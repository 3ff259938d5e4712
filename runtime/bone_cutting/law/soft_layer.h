// SPDX-License-Identifier: Apache-2.0
// Layers of soft tissue over the bone, such as skin, a ligament or
// the dura. Before its puncture a layer is a stiffening spring. Afterwards it is cut at a constant
// force, and there is friction between it and the shaft (Okamura, Simone and O'Leary, IEEE Trans.
// Biomed. Eng. 51, 2004).
//
// Each layer is an element of its own between the tip and the layer's front. It acts in parallel with the
// tip's element in the bone, because the layer stretches by millimetres and the bone by micrometres. Let z
// be the layer's stretch, which is max(0, stretch_m + slide of the tip in this tick). The layer's
// incremental potential is
//   W(z) = a1 z^2 / 2 + a2 z^3 / 3,
// which is convex in the slide because a1, a2 >= 0. Two internal variables describe the layer: whether it
// is punctured, and the depth of its front. The puncture changes no energy. The front only moves down. This
// shortens z, so W can only decrease.
//
// Contract (tests/runtime/bone_cutting/law/soft_layer_test.cpp, cutting_energy_test.cpp):
//  1. The energy inequality of cutting_law.h (contract 1) holds with `layer_cut_J` added on its left side.
//  2. Until the puncture, the layer's force is a1 z + a2 z^2 at the depth z below the surface.
//  3. The tip presses directly only on the uppermost layer that it has not cut through, and it presses on
//     all lower tissue through that layer. Therefore only that layer is punctured or cut. The force that
//     does so is the sum of the layer's own force and the forces of all tissue below it. A thin layer close
//     below a strong one can be cut in the same tick as the strong one, if it is stretched enough by then.
//  4. A punctured layer is cut down to its bottom at the force `cutting_N`. After that the layer exerts
//     only friction in this hole. The hole remains after the tool is withdrawn. A tool that returns within
//     a tool radius of the hole enters it again. Elsewhere the layer is uncut.
//  5. The stretch of a loaded layer is carried from tick to tick. The stretch of an unloaded layer is
//     computed from the geometry.
//  6. No allocation. A tick makes at most kMaxLayerAdvances front steps, and the remaining steps follow in
//     the next tick.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace trocar::runtime {

inline constexpr int kMaxLayerAdvances = 12;

struct SoftLayer {
  double top_m = 0, bottom_m = 0;  ///< depth, at rest
  double stiffness_N_per_m = 0;    ///< a1, at the surface
  double stiffening_N_per_m2 = 0;  ///< a2
  double puncture_N =
      0;  ///< puncture force, compared with the total force of this and all lower tissue
  double cutting_N = 0;         ///< force after the puncture, at most puncture_N
  double friction_N_per_m = 0;  ///< friction of the shaft per cut depth
};

/// Force, energy and stiffness of a layer that is stretched by z.
struct SoftSpring {
  double energy_J = 0, force_N = 0, stiffness_N_per_m = 0;
};
inline SoftSpring soft_spring(const SoftLayer& layer, double z_m) noexcept {
  if (z_m <= 0) return {};
  const double a1 = layer.stiffness_N_per_m, a2 = layer.stiffening_N_per_m2;
  return {z_m * z_m * (0.5 * a1 + z_m * a2 / 3), z_m * (a1 + z_m * a2), a1 + 2 * z_m * a2};
}
/// Stretch at which the layer's force is `force_N`; at least 0, and infinite if the layer has no stiffness.
double stretch_at(const SoftLayer& layer, double force_N) noexcept;

struct SoftHole {
  Eigen::Vector2d at_m = Eigen::Vector2d::Zero();  ///< position at the layer's top, x and y in {B}
  double cut_m = 0;                                ///< depth down to which the hole is cut
  std::uint64_t last_used = 0;                     ///< tick of the last use; 0: there is no hole
};

struct SoftLayerState {
  double stretch_m = 0;       ///< distance of the tip beyond the front, along the shaft
  bool is_punctured = false;  ///< the layer is punctured at the tool's position
  double cut_m = 0;           ///< depth of the front at the tool's position
  bool is_in = false;         ///< the tip is below the layer's top
  Eigen::Vector2d at_m = Eigen::Vector2d::Zero();  ///< position of the puncture
  std::vector<SoftHole> holes;  ///< fixed capacity; the oldest hole is forgotten first
};

}  // namespace trocar::runtime
