// SPDX-License-Identifier: Apache-2.0
// Soft tissue over the bone: a skin, a ligament, the dura. Before it is punctured it is a spring
// that stiffens, afterwards it is cut at a constant force and rubs along the shaft (Okamura,
// Simone and O'Leary, IEEE Trans. Biomed. Eng. 51, 2004).
//
// Each layer is an element of its own between the tip and the layer's front, parallel to the tip's
// element in the bone: its stretch is millimetres where the bone's is micrometres. Its incremental
// potential is
//   W(z) = a1 z^2 / 2 + a2 z^3 / 3,  z = max(0, stretch + slide of the tip in this tick),
// convex in the slide as a1, a2 >= 0. Its internal variables are the puncture, which changes no
// energy, and the front, which only goes down: that shortens z, so that W only falls.
//
// Contract (tests/runtime/cutting/soft_layer_test.cpp, cutting_energy_test.cpp):
//  1. The energy inequality of cutting_law.h (1.) with `layer_cut_J` added on its left side.
//  2. Until the puncture the layer's force is a1 z + a2 z^2 of its depth z below the surface.
//  3. The tip presses on the uppermost layer that it has not cut through, and on all below only
//     through it: that layer alone is punctured or cut, by the sum of their forces. So a thin layer
//     close behind a strong one is torn with it if it is stretched enough by then.
//  4. A punctured layer is cut at `cutting_N` until its bottom, and then gone for this hole. The
//     hole outlives withdrawal; a tool that comes within its radius of it goes into it. Elsewhere
//     the layer is whole.
//  5. Stretch is carried while it is loaded, and taken from geometry only where it is not.
//  6. No allocation; at most kMostLayerAdvances steps of fronts a tick. What is left is done in the
//     next tick.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace trocar::runtime {

inline constexpr int kMostLayerAdvances = 12;

struct SoftLayer {
  double top_m = 0, bottom_m = 0;  ///< depth, at rest
  double stiffness_N_per_m = 0;    ///< a1, at the surface
  double stiffening_N_per_m2 = 0;  ///< a2
  double puncture_N = 0;           ///< of all that the tip presses on
  double cutting_N = 0;            ///< after it, at most puncture_N
  double friction_N_per_m = 0;     ///< of the shaft, of cut depth
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
/// The stretch at which a layer has a force of at least 0; infinite if it has no stiffness.
double stretch_at(const SoftLayer& layer, double force_N) noexcept;

struct SoftHole {
  Eigen::Vector2d at_m = Eigen::Vector2d::Zero();  ///< in {B}, at the layer's top
  double cut_m = 0;                                ///< depth; above, the hole has taken all
  std::uint64_t last_used = 0;                     ///< tick; 0: there is no hole
};

struct SoftLayerState {
  double stretch_m = 0;                            ///< of the tip beyond the front, along the shaft
  bool is_punctured = false;                       ///< where the tool is
  double cut_m = 0;                                ///< depth of the front where the tool is
  bool is_in = false;                              ///< the tip is below the layer's top
  Eigen::Vector2d at_m = Eigen::Vector2d::Zero();  ///< where it was punctured
  std::vector<SoftHole> holes;  ///< as many as can be remembered; then the oldest is forgotten
};

}  // namespace trocar::runtime
