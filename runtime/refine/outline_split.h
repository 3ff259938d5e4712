// SPDX-License-Identifier: Apache-2.0
// Where to split a side on a sheet's boundary: on the lattice, so that refinement ends at sharp
// corners too.
#pragma once

#include <cstdint>
#include <optional>

#include "runtime/mesh/sheet_mesh.h"

namespace trocar::runtime {

/// Where on a side ab a split is wanted.
struct SplitAim {
  double fraction;                    ///< of the way from a to b
  bool on_shell_of_a, on_shell_of_b;  ///< the distance from this end matters; at most one of them
};

/// For side `side` of triangle `t` (on the boundary), to be split into about `pieces` (>= 2) equal
/// parts, one split at a time. Where the side leaves a corner at which the material's angle is
/// below 75 degrees, the aim is a power of two of steps from that corner, so that pieces of two
/// sides that meet there come to end at equal distances and do not encroach upon one another
/// (Ruppert's concentric shells, 1995). O(triangles at the side's ends).
SplitAim aim_split(const SheetMesh& mesh, std::uint32_t t, std::uint32_t side, int pieces) noexcept;

/// The lattice point exactly on ab that is nearest to the aim and is neither a nor b; none if there
/// is none.
std::optional<LatticePoint> point_on_side(LatticePoint a, LatticePoint b, SplitAim aim) noexcept;

/// A lattice point near the aim, on the side ab of the counter-clockwise triangle abc or less than
/// a step inside, and on no other side: that nearest to the shell, or if there is none to the side
/// (for the middle of the side no more than half a step off); none if there is no such point.
std::optional<LatticePoint> point_beside_side(LatticePoint a, LatticePoint b, LatticePoint c,
                                              SplitAim aim) noexcept;

}  // namespace trocar::runtime
