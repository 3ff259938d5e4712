// SPDX-License-Identifier: Apache-2.0
// The soft layers' part of one tick.
#pragma once

#include "runtime/cutting/tick.h"

namespace trocar::runtime {

/// The fronts: carried while they are loaded, else where the hole below the tip ends.
void find_layers(Tick& tick) noexcept;

/// Of the layers at a slide of the tip along the shaft since the tick's start.
SoftSpring spring_of_layers(const Tick& tick, double slide_m) noexcept;

/// Of the shaft, by the depth that is cut and filled (N).
double friction_of_layers(const Tick& tick) noexcept;

/// How far the front of the layer that the tip presses on goes.
struct LayerAdvance {
  int layer = -1;  ///< -1: none
  double length_m = 0, work_J = 0;
  double stiffness_N_per_m = 0;  ///< of the layer, before
  bool ends_layer = false;
};
/// Until the force on it, of `bone_N` and of all layers, is what cuts it. The force falls by the
/// share `falling` of the layer's stiffness a metre of the front: 1 with the tip where it is, less
/// where the tip follows. Punctures the layer if the force is enough.
LayerAdvance scan_layers(Tick& tick, double slide_m, double bone_N, double falling) noexcept;
/// The layer that the tip presses on; -1: none.
int pressed_layer(const Tick& tick, double slide_m) noexcept;
void take(Tick& tick, const LayerAdvance& advance, CuttingResult& out) noexcept;

/// At the tick's end: `slide_m` of the tip has been done.
void finish_layers(Tick& tick, double slide_m, CuttingResult& out) noexcept;

}  // namespace trocar::runtime
