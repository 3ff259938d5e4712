// SPDX-License-Identifier: Apache-2.0
// The soft layers' part of one tick (soft_layer.h).
// Tests: tests/runtime/bone_cutting/law/soft_layer_test.cpp
#pragma once

#include "runtime/bone_cutting/law/tick.h"

namespace trocar::runtime {

/// Determines the fronts: carried from tick to tick under load, otherwise the end of the hole below the tip.
void find_layers(Tick& tick) noexcept;

/// Force, energy and stiffness of all layers after a slide of the tip along the shaft in this tick.
SoftSpring spring_of_layers(const Tick& tick, double slide_m) noexcept;

/// Friction force of the layers on the shaft, from the depth that is cut and filled (N).
double friction_of_layers(const Tick& tick) noexcept;

/// Advance of the front of the layer that the tip presses on.
struct LayerAdvance {
  int layer = -1;  ///< -1: none
  double length_m = 0, work_J = 0;
  double stiffness_N_per_m = 0;  ///< stiffness of the layer before the advance
  bool ends_layer = false;
};
/// Computes the advance until the force on the layer, from `bone_N` and all layers, equals its cutting force.
/// Per metre of advance the force falls by `falling` times the layer's stiffness: 1 if the tip keeps its
/// position, less if the tip follows. Punctures the layer if the force suffices.
LayerAdvance scan_layers(Tick& tick, double slide_m, double bone_N, double falling) noexcept;
/// Index of the layer that the tip presses on; -1: none.
int pressed_layer(const Tick& tick, double slide_m) noexcept;
void take(Tick& tick, const LayerAdvance& advance, CuttingResult& out) noexcept;

/// Ends the tick, after a slide of the tip by `slide_m`.
void finish_layers(Tick& tick, double slide_m, CuttingResult& out) noexcept;

}  // namespace trocar::runtime
