// SPDX-License-Identifier: Apache-2.0
// The part of one tick that concerns the soft layers (soft_layer.h).
// Tests: tests/runtime/bone_cutting/law/soft_layer_test.cpp
#pragma once

#include "runtime/bone_cutting/law/tick.h"

namespace trocar::runtime {

/// Determines the front of each layer, which is the depth down to which the layer is cut. A loaded
/// layer keeps the front of the last tick. The front of an unloaded layer is the bottom of the hole
/// that the tip is in, or the layer's top if there is no hole.
void find_layers(Tick& tick) noexcept;

/// Returns the total force, energy and stiffness of all layers after the tip has slid by `slide_m`
/// along the shaft.
SoftSpring spring_of_layers(const Tick& tick, double slide_m) noexcept;

/// Returns the friction force of the layers on the shaft (N). It is proportional to the cut depth
/// that the shaft fills.
double friction_of_layers(const Tick& tick) noexcept;

/// Advance of the front of the layer that the tip presses on.
struct LayerAdvance {
  int layer = -1;                   ///< index of the layer; -1: no front advances
  double length_m = 0, work_J = 0;  ///< length along the shaft, and work of cutting
  double stiffness_N_per_m = 0;     ///< stiffness of the layer before the advance
  bool ends_layer = false;          ///< the front reaches the bottom of the layer
};
/// If the total force suffices, punctures the layer that the tip presses on. The total force is
/// `bone_N` plus the force of all layers. If the layer is punctured, computes the advance after
/// which the total force equals the layer's cutting force. Per metre of advance the force falls by
/// `falling` times the layer's stiffness. `falling` is 1 if the tip keeps its position, and less
/// than 1 if the tip follows the front.
LayerAdvance scan_layers(Tick& tick, double slide_m, double bone_N, double falling) noexcept;
/// Returns the index of the layer that the tip presses on; -1: none.
int pressed_layer(const Tick& tick, double slide_m) noexcept;
/// Moves the layer's front by `advance`, and adds the work to `out`.
void take(Tick& tick, const LayerAdvance& advance, CuttingResult& out) noexcept;

/// Updates the layers at the end of a tick in which the tip has slid by `slide_m`.
void finish_layers(Tick& tick, double slide_m, CuttingResult& out) noexcept;

}  // namespace trocar::runtime
