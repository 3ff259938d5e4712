// SPDX-License-Identifier: Apache-2.0
// The cutting front: its depth, and its advance under a force. It only moves down, to the first equilibrium
// on its way.
// Tests: tests/runtime/bone_cutting/law/cutting_law_test.cpp
#pragma once

#include "runtime/bone_cutting/law/tick.h"

namespace trocar::runtime {

/// Determines the front: it is carried from tick to tick under load, otherwise it is the next material below
/// the tip.
void find_front(Tick& tick) noexcept;

/// Advance of the front along the shaft, its work, and the strength before its end.
struct Advance {
  double length_m = 0, work_J = 0, strength_N = 0;
  bool ends_free = false;  ///< the front leaves all material
};

/// Computes the advance until the tip's force, which falls from `tip_N` by `per_m` (N/m) along the shaft, does
/// not exceed the strength.
Advance scan(const Tick& tick, double tip_N, double per_m) noexcept;

void take(Tick& tick, const Advance& advance, CuttingResult& out) noexcept;

/// The values that a step of the front changes, kept to undo the step.
struct FrontMemory {
  double stretch_m, front_m, cut_J;
  bool is_free;
};
FrontMemory remember(const Tick& tick, const CuttingResult& out) noexcept;
void take_back(Tick& tick, const FrontMemory& was, CuttingResult& out) noexcept;

}  // namespace trocar::runtime
