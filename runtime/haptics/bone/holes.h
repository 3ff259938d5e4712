// SPDX-License-Identifier: Apache-2.0
// Keeps track of the holes: which hole the tool is in, how deep each slab has been cut, and which
// length of each slab the shaft fills.
#pragma once

#include "runtime/haptics/bone/tick.h"

namespace trocar::runtime {

/// Sets `tick.hole` to the index of the hole that the tool is in, or would enter at its
/// present position.
void choose_hole(Tick& tick) noexcept;
/// Returns the depth down to which a slab is already cut at the tool's position, or minus infinity
/// if the slab is uncut.
double cut_of(const Tick& tick, int slab) noexcept;
/// Returns the depth down to which a slab is cut at the position of a tool with this tip and axis,
/// by any hole that `state` remembers; minus infinity if the slab is uncut there. For ticks without
/// forces, in which the tool is in no hole.
double cut_by_any_hole(const CuttingOptions& options, const CuttingState& state,
                       const CuttingSlab& slab, std::size_t index, const Eigen::Vector3d& tip,
                       const Eigen::Vector3d& axis) noexcept;
/// Updates whether the tool is in a hole. The tool is in a hole as long as both the tip and the
/// front are below the top of the hole's uppermost slab.
void enter_or_leave(Tick& tick) noexcept;
/// Updates the lengths of the shaft that are embedded in the slabs, and the stiffnesses of friction
/// and walls, which grow with these lengths. If friction or a wall gets stiffer, its force is kept
/// and its deflection is reduced, so that its energy falls. A new wall starts without force.
void embed(Tick& tick) noexcept;

/// Call this at the end of a tick in which the tool is in a hole. `tip`, `axis`: the tool at the
/// end of the tick. Walls that are loaded beyond their strength stay where the shaft pushed them.
/// Returns the energy that the walls store (J).
double yield_walls(Tick& tick, const Eigen::Vector3d& tip, const Eigen::Vector3d& axis) noexcept;
/// Records that the bone which the front has passed in this tick is cut, and sets the range of
/// passed slabs in `out`. If the tool is not in a hole, a new hole begins at the tool's position.
void record_cut(Tick& tick, const Eigen::Vector3d& tip, const Eigen::Vector3d& axis,
                CuttingResult& out) noexcept;
/// Call this at the start of a tick, before enter_or_leave(). If a bevelled tip drifted to the side
/// in the last tick, the front moved down with the tip (cutting_law.h, contract 7). Like
/// record_cut(), the function records that the bone passed by this motion is cut.
void record_drift(Tick& tick, CuttingResult& out) noexcept;

}  // namespace trocar::runtime
