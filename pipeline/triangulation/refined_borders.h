// SPDX-License-Identifier: GPL-3.0-or-later
// Adds to the borders between several materials the points that refinement inserted on them.
#pragma once

#include <span>

#include "formats/geometry/slice_mesh.h"
#include "pipeline/contour/label_borders.h"

namespace trocar::pipeline {

/// Returns the borders with the points at which refinement split their edges. Preconditions:
/// `outlines` are material_outlines(borders), the materials' outlines before refinement; `stored`
/// are the same outlines with the vertices that refinement inserted on their edges; `outlines` and
/// `stored` have the same rings in the same order, and each ring has the same first vertex in both.
/// (If the first vertices differ, check_shared_borders() of formats/geometry/shared_borders.h
/// fails.) O(n log n).
LabelBorders refined_borders(const LabelBorders& borders, std::span<const Pslg> outlines,
                             std::span<const Pslg> stored);

}  // namespace trocar::pipeline
