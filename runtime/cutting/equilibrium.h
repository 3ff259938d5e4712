// SPDX-License-Identifier: Apache-2.0
// The proxy at the potential's minimum and the front at its first equilibrium, together, by
// Newton's method. No step raises the potential.
#pragma once

#include "runtime/cutting/potential.h"

namespace trocar::runtime {

/// `e`: of the proxy at the tick's start; at the end, where it has come to.
void settle(Tick& tick, Evaluation& e, CuttingResult& out) noexcept;

}  // namespace trocar::runtime
