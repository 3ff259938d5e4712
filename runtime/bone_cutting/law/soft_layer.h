// SPDX-License-Identifier: Apache-2.0
// Layers of soft tissue over the bone, such as skin, a ligament or the dura. Before its puncture a
// layer is a stiffening spring. After the puncture the layer is cut at a constant force, and there
// is friction between the layer and the shaft (Okamura, Simone and O'Leary, IEEE Trans. Biomed.
// Eng. 51, 2004).
//
// Each layer is a spring of its own between the tip and the layer's front, which is the depth
// down to which the layer is cut. The forces of this spring and of the tip's spring in the bone add
// up. The two springs have separate stretches, because a layer stretches by millimetres and bone by
// micrometres. Let z be the layer's stretch: stretch_m plus the tip's displacement along the shaft
// in this tick, but at least 0. The layer's incremental potential is
//   W(z) = a1 z^2 / 2 + a2 z^3 / 3,
// which is convex in the displacement because a1, a2 >= 0. Two internal variables describe the
// layer: whether it is punctured, and the depth of its front. The puncture changes no energy. The
// front only moves down. This motion shortens z, so W can only decrease.
//
// Contract (tests/runtime/bone_cutting/law/soft_layer_test.cpp, cutting_energy_test.cpp):
//  1. The energy inequality of cutting_law.h (contract 1) holds with `layer_cut_J` added on its left side.
//  2. If the tip came from above, the layer's force until the puncture is a1 z + a2 z^2. Here z is
//     the distance along the shaft from the layer's top down to the tip.
//  3. The tip presses directly only on the uppermost layer that it has not cut through. It presses
//     on all lower tissue through that layer. Therefore only that layer can be punctured or cut.
//     The force that punctures or cuts it is the sum of the layer's own force and the forces of all
//     tissue below. A thin layer close below a strong one can be cut in the same tick as the strong
//     one, if at that moment the force on the thin layer already exceeds its puncture force.
//  4. A punctured layer is cut down to its bottom at the force `cutting_N`. When it is cut
//     through, the layer exerts only friction in this hole. The hole remains after the tool is
//     withdrawn. A tool that returns within a tool radius of the hole enters the hole again.
//     Elsewhere the layer is uncut.
//  5. While the stretch of a layer is positive (the layer is loaded), it is carried from tick to
//     tick. Otherwise it is computed from the geometry in each tick.
//  6. No allocation. In one tick the fronts of layers advance at most kMaxLayerAdvances times. If
//     more advances are necessary, they follow in the next tick.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace trocar::runtime {

inline constexpr int kMaxLayerAdvances = 12;

struct SoftLayer {
  double top_m = 0, bottom_m = 0;  ///< depths while the layer is unstretched
  double stiffness_N_per_m = 0;    ///< a1, the stiffness of the unstretched layer
  double stiffening_N_per_m2 = 0;  ///< a2, which makes the layer stiffer when stretched
  /// The layer is punctured when the total force of this layer and all lower tissue exceeds this
  /// force.
  double puncture_N = 0;
  double cutting_N = 0;         ///< force of cutting after the puncture, at most puncture_N
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
/// Returns the stretch at which the layer's force is `force_N`. The stretch is at least 0, and
/// infinite if the layer has no stiffness.
double stretch_at(const SoftLayer& layer, double force_N) noexcept;

struct SoftHole {
  Eigen::Vector2d at_m = Eigen::Vector2d::Zero();  ///< position at the layer's top, x and y in {B}
  double cut_m = 0;                                ///< depth down to which the hole is cut
  std::uint64_t last_used = 0;                     ///< number of the tick of last use; 0: no hole
};

struct SoftLayerState {
  double stretch_m = 0;       ///< distance of the tip beyond the front, along the shaft
  bool is_punctured = false;  ///< the layer is punctured at the tool's position
  double cut_m = 0;           ///< depth of the front at the tool's position
  bool is_in = false;         ///< the tip is below the layer's top
  Eigen::Vector2d at_m = Eigen::Vector2d::Zero();  ///< position of the puncture
  std::vector<SoftHole> holes;  ///< fixed size; a new hole replaces the least recently used one
};

}  // namespace trocar::runtime
