// SPDX-License-Identifier: Apache-2.0
// Which hole the tool is in, what each slab of it has lost, and how much of it the shaft fills.
#pragma once

#include "runtime/cutting/tick.h"

namespace trocar::runtime {

/// `tick.hole`: the hole that the tool is in, or would enter.
void choose_hole(Tick& tick) noexcept;
/// Depth above which a slab has nothing to cut for the tool where it is; minus infinity: all of it.
double cut_of(const Tick& tick, int slab) noexcept;
/// The tool is in a hole as long as it is below the top of the hole's first slab.
void enter_or_leave(Tick& tick) noexcept;
/// Embedded lengths, and with them the stiffness of friction and walls. What grows keeps its force,
/// so that its energy falls; what is new is free of force.
void embed(Tick& tick) noexcept;

/// At the tick's end, for the shaft where it is then: walls beyond their strength stay where they
/// were pushed. Returns the energy that the walls store (J).
double yield_walls(Tick& tick, const Eigen::Vector3d& tip, const Eigen::Vector3d& axis) noexcept;
/// What lies above the front is cut, in the hole that the tool is in or now begins.
void record_cut(Tick& tick, const Eigen::Vector3d& tip, const Eigen::Vector3d& axis,
                CuttingResult& out) noexcept;

}  // namespace trocar::runtime
