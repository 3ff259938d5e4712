// SPDX-License-Identifier: Apache-2.0
// How much of the tool has material under it, and where.
#pragma once

#include <Eigen/Core>
#include <span>

#include "runtime/contact/sheet.h"
#include "runtime/contact/tool.h"

namespace trocar::runtime {

struct Overlap {
  double fraction = 0;  ///< of the outline's area, in [0, 1]
  /// Of the overlapped area, in lattice steps; the outline's own where it is all material.
  Eigen::Vector2d centroid_steps = Eigen::Vector2d::Zero();
};

/// The tool's outline intersected with the sheet's material, less the holes. The fraction is
/// exactly 0 or 1 where it is within 1e-9 of it; 0 for an empty outline. `holes` are outlines of
/// the same tool, at most kMaxPendingHoles. Every piece of every triangle is clipped in a buffer of
/// fixed capacity; nothing is allocated. Time proportional to the triangles near the tool.
Overlap overlap(const Sheet& sheet, const Tool& tool, const LatticeOutline& outline,
                std::span<const LatticeOutline> holes) noexcept;

}  // namespace trocar::runtime
