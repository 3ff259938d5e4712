// SPDX-License-Identifier: Apache-2.0
// The cutting front (the depth down to which bone has been cut under the tool), and its advance
// under a force. An advance only moves the front down, and stops at the first equilibrium.
#pragma once

#include "runtime/bone_cutting/law/tick.h"

namespace trocar::runtime {

/// Determines the depth of the front. While the tip presses on the front, the front lies above the
/// tip by CuttingState::stretch_m, measured along the shaft, or at the depth of the slab
/// CuttingState::bearing if there is one. Otherwise the front is at the uppermost uncut material at
/// or below the tip. If there is no such material, the depth is infinite.
void find_front(Tick& tick) noexcept;

/// Advance of the front along the shaft.
struct Advance {
  /// Length and work of the advance, and strength of the material at its lower end.
  double length_m = 0, work_J = 0, strength_N = 0;
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
  double stretch_m, front_m, cut_J;
  bool is_free;
};
FrontMemory remember(const Tick& tick, const CuttingResult& out) noexcept;
void take_back(Tick& tick, const FrontMemory& was, CuttingResult& out) noexcept;

}  // namespace trocar::runtime
