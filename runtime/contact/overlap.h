// SPDX-License-Identifier: Apache-2.0
// The coverage of the tool, which is the fraction of the area of its outline that lies over material, and
// the centroid of the covered area.
#pragma once

#include <Eigen/Core>
#include <span>

#include "runtime/contact/sheet.h"
#include "runtime/contact/tool.h"

namespace trocar::runtime {

struct Overlap {
  double coverage = 0;  ///< fraction of the outline's area that lies over material, in [0, 1]
  /// Centroid of the covered area, in lattice steps. If the coverage is 0 or 1, this is the
  /// centroid of the whole outline.
  Eigen::Vector2d centroid_steps = Eigen::Vector2d::Zero();
};

/// Intersects the tool's outline with the sheet's material, without the material in `holes`. The
/// holes are outlines of the same tool that are not yet cut into the mesh, at most
/// kMaxPendingHoles. A coverage within 1e-9 of 0 or 1 is set to exactly 0 or 1. An empty outline
/// has coverage 0. The function does not allocate. Its time is proportional to the number of
/// triangles near the tool.
Overlap overlap(const Sheet& sheet, const Tool& tool, const LatticeOutline& outline,
                std::span<const LatticeOutline> holes) noexcept;

/// Returns the fraction of the outline's area that lies outside all `holes`, whether there is
/// material or not. The holes are outlines of the same tool, at most kMaxPendingHoles. A fraction
/// within 1e-9 of 0 or 1 is set to exactly 0 or 1. An empty outline gives 1. No allocation.
double outline_outside(const Tool& tool, const LatticeOutline& outline,
                       std::span<const LatticeOutline> holes) noexcept;

}  // namespace trocar::runtime
