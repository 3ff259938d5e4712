// SPDX-License-Identifier: Apache-2.0
// Where to split a side on a sheet's boundary: on the lattice, so that refinement ends at sharp
// corners too.
#pragma once

#include <cstdint>
#include <optional>

#include "runtime/remesh/sheet_mesh.h"

namespace trocar::runtime {

/// What fraction of the way along side `side` of triangle `t` (on the boundary) to split it into
/// about `pieces` (>= 2) equal parts, one split at a time. Where the side leaves a corner at which
/// the material's angle is below 75 degrees, a power of two of steps from that corner, so that
/// pieces of two sides that meet there come to end at equal distances and do not encroach upon one
/// another (Ruppert's concentric shells, 1995). O(triangles at the side's ends).
double split_fraction(const SheetMesh& mesh, std::uint32_t t, std::uint32_t side,
                      int pieces) noexcept;

/// The lattice point exactly on ab that is nearest to the given fraction of the way and is neither
/// a nor b; none if there is none.
std::optional<LatticePoint> point_on_side(LatticePoint a, LatticePoint b, double fraction) noexcept;

/// Of the lattice points around the given fraction of the way the one nearest to the side ab of the
/// counter-clockwise triangle abc, on it or inside the triangle and on no other side; none if there
/// is none. Less than one step from the side, at fraction 1/2 no more than half a step.
std::optional<LatticePoint> point_beside_side(LatticePoint a, LatticePoint b, LatticePoint c,
                                              double fraction) noexcept;

}  // namespace trocar::runtime
