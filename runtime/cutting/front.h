// SPDX-License-Identifier: Apache-2.0
// The cutting front: where it is, and how far it goes at a force. It only moves down, to the first
// equilibrium on its way.
#pragma once

#include "runtime/cutting/tick.h"

namespace trocar::runtime {

/// The front: carried while it is loaded, else the next material below the tip.
void find_front(Tick& tick) noexcept;

/// How far the front goes along the shaft, with its work and the strength before its end.
struct Advance {
  double length_m = 0, work_J = 0, strength_N = 0;
  bool ends_free = false;  ///< in no material
};

/// How far the front moves until the tip's force, which falls from `tip_N` by `per_m` (N/m) along
/// the shaft, is no more than the strength.
Advance scan(const Tick& tick, double tip_N, double per_m) noexcept;

void take(Tick& tick, const Advance& advance, CuttingResult& out) noexcept;

/// What a step of the front changes, to be able to take it back.
struct FrontMemory {
  double stretch_m, front_m, cut_J;
  bool is_free;
};
FrontMemory remember(const Tick& tick, const CuttingResult& out) noexcept;
void take_back(Tick& tick, const FrontMemory& was, CuttingResult& out) noexcept;

}  // namespace trocar::runtime
