// SPDX-License-Identifier: GPL-3.0-or-later
// Reduces the number of vertices on the outline, within a tolerance and without changing
// the topology.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "formats/geometry/slice_mesh.h"

namespace trocar::pipeline {

enum class SimplificationMethod : std::uint8_t {
  kArea,            ///< segment collapse that keeps every ring's area (area_collapse.h)
  kDouglasPeucker,  ///< Douglas and Peucker (1973): the vertices are a subset of the contour's
};

struct SimplificationOptions {
  double tolerance_mm = 0.2;  ///< two-sided Hausdorff bound between each ring and its contour
  SimplificationMethod method = SimplificationMethod::kArea;
};

/// Returns one ring for each ring of `contours` (valid by check_pslg), in the same order. No ring
/// crosses itself or another ring, and none collapses. Each ring keeps its orientation and stays
/// inside or outside the same other rings. With a tolerance of 0 both methods remove exactly the
/// vertices on the line between their neighbours. Where Douglas-Peucker would change the topology,
/// it keeps more vertices, if necessary all of them. Its repair loop ends because each round adds
/// contour vertices. With both methods, clear_outline() (outline_clearance.h) then removes edges
/// and gaps of a few lattice steps. O(n log n) typically.
Pslg simplify(const Pslg& contours, const Lattice& lattice, const SimplificationOptions& options);

/// Like simplify(), but for lines that may share ends. A line for which `is_open` is true keeps its
/// first and last vertex, which are not joined. Douglas-Peucker calls `mark_misplaced` as soon as
/// nothing crosses. The callback must mark, by index, the simplified lines whose topology still
/// differs from that of the original lines. These lines then get more vertices. Segment collapse
/// does not call it, because it never changes the topology.
using MarkMisplaced =
    std::function<void(const std::vector<Ring>& simplified, std::vector<char>& marks)>;
Pslg simplify_lines(const Pslg& lines, const std::vector<bool>& is_open, const Lattice& lattice,
                    const SimplificationOptions& options, const MarkMisplaced& mark_misplaced);

/// The distance from the edges, in lattice steps, at which refinement may place points without
/// leaving the tolerance. The distance is infinite if the method does not reserve a part of the
/// tolerance, or if the tolerance is 0.
double left_for_refinement_steps(const Lattice& lattice, const SimplificationOptions& options);

/// Largest two-sided Hausdorff distance between each contour and the ring of the same index, in mm,
/// with a relative accuracy of 1e-10. If `is_open` is given, contours for which it is true are
/// lines, as in simplify_lines(). O(n log n) typically.
double hausdorff_mm(const Pslg& contours, const Pslg& rings, const Lattice& lattice,
                    const std::vector<bool>& is_open = {});

}  // namespace trocar::pipeline
