// SPDX-License-Identifier: Apache-2.0
// The part of one tick that concerns the soft layers (soft_layer.h).
#pragma once

#include "runtime/bone_cutting/law/tick.h"

namespace trocar::runtime {

/// Determines the front of each layer, which is the depth down to which the layer is cut. A layer
/// that the tip stretches keeps the front of the last tick. The front of any other layer is the
/// bottom of the hole that the tip is in, or the layer's top if there is no hole.
void find_layers(Tick& tick) noexcept;

/// Returns the total force, energy and stiffness of all layers. `slide_m`, here and below: the
/// tip's displacement along the shaft since the start of the tick.
SoftSpring spring_of_layers(const Tick& tick, double slide_m) noexcept;

/// Returns the friction force of the layers on the shaft (N). Each layer's friction is proportional
/// to the length of the shaft in the cut part of the layer.
double friction_of_layers(const Tick& tick) noexcept;

/// Advance of the front of the layer that the tip presses on.
struct LayerAdvance {
  int layer = -1;                   ///< index of the layer; -1: no front advances
  double length_m = 0, work_J = 0;  ///< length along the shaft, and work of cutting
  double stiffness_N_per_m = 0;     ///< stiffness of the layer before the advance
  bool ends_layer = false;          ///< the front reaches the bottom of the layer
};
/// Let the total force be `bone_N` (the tip's force on the bone) plus the forces of all layers. If
/// the total force exceeds puncture_N of the layer that the tip presses on, this layer is
/// punctured, and its bit is set in CuttingResult::layers_punctured. For a punctured layer, the
/// function computes the advance after which the total force equals the layer's cutting_N. An
/// advance of length L reduces the total force by L times the layer's stiffness times `falling`.
/// `falling` is 1 if the tip keeps its position, and less than 1 if the tip follows the front.
LayerAdvance scan_layers(Tick& tick, double slide_m, double bone_N, double falling,
                         CuttingResult& out) noexcept;
/// Returns the index of the layer that the tip presses on; -1: none.
int pressed_layer(const Tick& tick, double slide_m) noexcept;
/// Moves the front of the layer `advance.layer`, and adds the work of cutting to `out`.
void take(Tick& tick, const LayerAdvance& advance, CuttingResult& out) noexcept;

/// Call this at the end of a tick. Adds `slide_m` to each layer's SoftLayerState::stretch_m, which
/// stays at most 0 in a layer that is cut through. Adds the layers' force to `out`.
void finish_layers(Tick& tick, double slide_m, CuttingResult& out) noexcept;

}  // namespace trocar::runtime
