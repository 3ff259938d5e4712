// SPDX-License-Identifier: Apache-2.0
// The share of the tool outline over material, and the centroid of that area.
#pragma once

#include <Eigen/Core>
#include <span>

#include "runtime/contact/sheet.h"
#include "runtime/contact/tool.h"

namespace trocar::runtime {

struct Overlap {
  double fraction = 0;  ///< of the outline's area, in [0, 1]
  /// Of the area over material, in lattice steps; of the whole outline where the fraction is 0
  /// or 1.
  Eigen::Vector2d centroid_steps = Eigen::Vector2d::Zero();
};

/// The tool's outline intersected with the sheet's material, less the holes. A fraction within 1e-9
/// of 0 or 1 is exactly that; for an empty outline it is 0. `holes`: outlines of the same tool, at
/// most kMaxPendingHoles. Clips in buffers of fixed capacity; no allocation. Time proportional to
/// the triangles near the tool.
Overlap overlap(const Sheet& sheet, const Tool& tool, const LatticeOutline& outline,
                std::span<const LatticeOutline> holes) noexcept;

/// The share of the tool's outline outside of all holes, wherever material is; 1 for an empty one.
/// `holes` and a share near 0 or 1 as above. No allocation.
double outline_outside(const Tool& tool, const LatticeOutline& outline,
                       std::span<const LatticeOutline> holes) noexcept;

}  // namespace trocar::runtime
