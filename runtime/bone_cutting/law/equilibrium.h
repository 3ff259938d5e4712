// SPDX-License-Identifier: Apache-2.0
// Finds the proxy's pose of minimal potential, and the first equilibrium of the cutting front, by
// Newton's method. The front is in equilibrium if the tip's force does not exceed the strength of
// the bone at the front. No step raises the potential.
// Tests: tests/runtime/bone_cutting/law/cutting_energy_test.cpp
#pragma once

#include "runtime/bone_cutting/law/potential.h"

namespace trocar::runtime {

/// Moves the proxy, the front and the fronts of soft layers to the equilibrium. Precondition: `e`
/// is the potential at the start of the tick. On return `e` is the potential at the proxy's new
/// pose. If Newton's method did not converge, `out.has_converged` is false.
void settle(Tick& tick, Evaluation& e, CuttingResult& out) noexcept;

}  // namespace trocar::runtime
