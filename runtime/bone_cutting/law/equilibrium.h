// SPDX-License-Identifier: Apache-2.0
// Finds the equilibrium of a tick by Newton's method. The proxy moves to a minimum of the potential
// for the present cutting front. The potential is the sum of the energies of all elements, such as
// coupling, friction and walls (potential.h). The front then moves down to the first depth at
// which the tip's force does not exceed the strength of the bone; the front is then in equilibrium.
// No step raises the potential.
#pragma once

#include "runtime/bone_cutting/law/potential.h"

namespace trocar::runtime {

/// Moves the proxy, the front and the fronts of soft layers to the equilibrium. Precondition: `e`
/// is the potential at the start of the tick. On return `e` is the potential at the proxy's new
/// pose. If Newton's method did not converge, `out.has_converged` is false.
void settle(Tick& tick, Evaluation& e, CuttingResult& out) noexcept;

}  // namespace trocar::runtime
