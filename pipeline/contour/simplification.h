// SPDX-License-Identifier: GPL-3.0-or-later
// Fewer vertices on the outline: Douglas and Peucker (1973), with the topology preserved.
#pragma once

#include "formats/geometry/slice_mesh.h"

namespace trocar::pipeline {

struct SimplificationOptions {
  double tolerance_mm = 0.25;  ///< two-sided Hausdorff bound between each ring and its contour
};

/// One ring for each ring of `contours` (valid by check_pslg), in the same order, its vertices a
/// subset. No ring crosses another or itself or collapses, and each keeps its orientation and its
/// place inside or outside the others: where plain Douglas-Peucker would violate this, the spans
/// involved keep more vertices, down to the contour itself if need be.
/// O(n log n) typically; the repair loop ends because each round adds contour vertices.
Pslg simplify(const Pslg& contours, const Lattice& lattice, const SimplificationOptions& options);

/// Largest distance between each contour and its simplified ring, either way, in mm. Rings
/// correspond by index, and simplified vertices are contour vertices in their order.
double hausdorff_mm(const Pslg& contours, const Pslg& simplified, const Lattice& lattice);

}  // namespace trocar::pipeline
