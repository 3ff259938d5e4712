// SPDX-License-Identifier: Apache-2.0
// The cutting front, and the soft layers in a tick.
#pragma once

#include "runtime/haptics/bone/tick.h"

namespace trocar::runtime {

// The cutting front (the depth down to which bone has been cut under the tool), and its advance
// under a force. An advance only moves the front down, and stops at the first equilibrium.

/// Determines the depth of the front. While the tip presses on the front, the front lies above the
/// tip by CuttingState::stretch_m, measured along the shaft, or at the depth of the slab
/// CuttingState::bearing if there is one. Otherwise the front is at the uppermost uncut material at
/// or below the tip. If there is no such material, the depth is infinite.
void find_front(Tick& tick) noexcept;

/// Advance of the front along the shaft.
struct Advance {
  /// Length and work of the advance, and strength of the material at its lower end.
  double length_m = 0, work_J = 0, strength_N = 0;
  double cut_m = 0;  ///< part of the length that goes through bone
  /// The advance ends where no bone holds the tip: in already cut bone, in a gap between slabs, or
  /// below all bone. In this case strength_N is 0.
  bool ends_free = false;
};

/// Computes the advance after which the tip's force no longer exceeds the strength. `tip_N`: the
/// tip's force before the advance. `per_m`: decrease of this force per metre of advance.
Advance scan(const Tick& tick, double tip_N, double per_m) noexcept;

/// Returns CuttingState::bearing at the end of this tick: the index of the slab of thickness 0 on
/// which the tip rests; -1: none.
int bearing_slab(const Tick& tick) noexcept;

/// Moves the front by `advance`, and adds the work to `out`.
void take(Tick& tick, const Advance& advance, CuttingResult& out) noexcept;

/// Copy of the values that take() changes, to undo an advance that went too far or raised the
/// potential. remember() makes the copy, and take_back() restores the values.
struct FrontMemory {
  double stretch_m, front_m, cut_m, cut_J;
  bool is_free;
};
FrontMemory remember(const Tick& tick, const CuttingResult& out) noexcept;
void take_back(Tick& tick, const FrontMemory& was, CuttingResult& out) noexcept;

// The part of one tick that concerns the soft layers (walls.h).

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
