// SPDX-License-Identifier: Apache-2.0
// The holes: which hole the tool is in, how deep each slab has been cut, and how much of it the shaft fills.
// Tests: tests/runtime/bone_cutting/law/hole_test.cpp
#pragma once

#include "runtime/bone_cutting/law/tick.h"

namespace trocar::runtime {

/// Sets `tick.hole` to the hole that the tool is in or would enter.
void choose_hole(Tick& tick) noexcept;
/// Depth down to which a slab is already cut at the tool's position; minus infinity: the slab is uncut.
double cut_of(const Tick& tick, int slab) noexcept;
/// Updates whether the tool is in a hole. It is in one as long as the tip and the front are both below the
/// top of the hole's first slab.
void enter_or_leave(Tick& tick) noexcept;
/// Updates the embedded lengths, and with them the stiffness of friction and walls. An element that gets
/// stiffer keeps its force, so that its energy falls. A new element starts without force.
void embed(Tick& tick) noexcept;

/// Call this at the end of a tick. Walls that are loaded beyond their strength stay where the shaft pushed
/// them. Returns the energy that the walls store (J).
double yield_walls(Tick& tick, const Eigen::Vector3d& tip, const Eigen::Vector3d& axis) noexcept;
/// Records all material above the front as cut. If the tool is not in a hole, a new hole begins here.
void record_cut(Tick& tick, const Eigen::Vector3d& tip, const Eigen::Vector3d& axis,
                CuttingResult& out) noexcept;

}  // namespace trocar::runtime
