// SPDX-License-Identifier: Apache-2.0
// The cutting front (the depth down to which bone has been cut under the tool), and its advance
// under a force. An advance only moves the front down, and stops at the first equilibrium.
// Tests: tests/runtime/bone_cutting/law/cutting_law_test.cpp
#pragma once

#include "runtime/bone_cutting/law/tick.h"

namespace trocar::runtime {

/// Determines the depth of the front. While the tip presses on the front, the front stays where it
/// was in the last tick. Otherwise the front is at the uppermost uncut material at or below the
/// tip. If there is none, the depth is infinite.
void find_front(Tick& tick) noexcept;

/// Advance of the front along the shaft.
struct Advance {
  /// Length and work of the advance, and strength of the material at its lower end.
  double length_m = 0, work_J = 0, strength_N = 0;
  bool ends_free = false;  ///< after the advance the tip presses on nothing; strength_N is 0
};

/// Computes the advance after which the tip's force no longer exceeds the strength. The force is `tip_N`
/// before the advance and falls by `per_m` (N per metre of advance).
Advance scan(const Tick& tick, double tip_N, double per_m) noexcept;

/// Returns the index of the slab of thickness 0 on which the tip rests at the end of this tick, or
/// -1 (CuttingState::bearing).
int bearing_slab(const Tick& tick) noexcept;

/// Moves the front by `advance`, and adds the work to `out`.
void take(Tick& tick, const Advance& advance, CuttingResult& out) noexcept;

/// Copy of the values that take() changes. remember() makes the copy, take_back() restores it.
struct FrontMemory {
  double stretch_m, front_m, cut_J;
  bool is_free;
};
FrontMemory remember(const Tick& tick, const CuttingResult& out) noexcept;
void take_back(Tick& tick, const FrontMemory& was, CuttingResult& out) noexcept;

}  // namespace trocar::runtime
