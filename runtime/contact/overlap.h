// SPDX-License-Identifier: Apache-2.0
// The coverage of the tool: the part of its outline that lies over material, and the centroid of that area.
#pragma once

#include <Eigen/Core>
#include <span>

#include "runtime/contact/sheet.h"
#include "runtime/contact/tool.h"

namespace trocar::runtime {

struct Overlap {
  double coverage = 0;  ///< part of the outline's area over material, in [0, 1]
  /// Centroid of the covered area, in lattice steps; that of the whole outline if the coverage is 0 or 1.
  Eigen::Vector2d centroid_steps = Eigen::Vector2d::Zero();
};

/// The tool's outline intersected with the sheet's material, less the holes. A coverage within 1e-9
/// of 0 or 1 is set to exactly that; for an empty outline it is 0. `holes`: outlines of the same tool, at
/// most kMaxPendingHoles. Clips in buffers of fixed capacity; no allocation. Time proportional to
/// the triangles near the tool.
Overlap overlap(const Sheet& sheet, const Tool& tool, const LatticeOutline& outline,
                std::span<const LatticeOutline> holes) noexcept;

/// The part of the tool's outline outside of all holes, regardless of material; 1 for an empty outline.
/// `holes` and values near 0 or 1 as above. No allocation.
double outline_outside(const Tool& tool, const LatticeOutline& outline,
                       std::span<const LatticeOutline> holes) noexcept;

}  // namespace trocar::runtime
