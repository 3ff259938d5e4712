// SPDX-License-Identifier: GPL-3.0-or-later
// Reduces the number of vertices on the outline, within a tolerance and without changing
// the topology.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "formats/mesh/slice_mesh.h"

namespace trocar::pipeline {

enum class SimplificationMethod : std::uint8_t {
  kArea,            ///< segment collapse that keeps every ring's area (area_collapse.h)
  kDouglasPeucker,  ///< Douglas and Peucker (1973): keeps a subset of the contour's vertices
};

struct SimplificationOptions {
  double tolerance_mm = 0.2;  ///< largest two-sided Hausdorff distance from a ring to its contour
  SimplificationMethod method = SimplificationMethod::kArea;
};

/// Returns one ring for each ring of `contours`, in the same order. Precondition: `contours` passes
/// check_pslg(). No ring of the result crosses itself or another ring, and none has an area of 0.
/// Each ring keeps its orientation and stays inside or outside the same other rings. With a
/// tolerance of 0 both methods remove exactly the vertices on the line between their neighbours.
/// Where Douglas-Peucker would change the topology, it keeps more vertices, if necessary all of
/// them. The last step is clear_outline() (outline_clearance.h), which removes edges and gaps of
/// a few lattice steps. With Douglas-Peucker, or a tolerance of 0, this step is left out if a
/// rotation may map the outline to itself. O(n log n) typically.
Pslg simplify(const Pslg& contours, const Lattice& lattice, const SimplificationOptions& options);

/// simplify_lines() is like simplify(), but also for open lines, which may share ends. If
/// is_open[i] is true, ring i is a line: its first and last vertex stay and are not joined. If
/// there are no lines, `is_open` and `mark_misplaced` may be empty. Douglas-Peucker first adds
/// vertices until no lines cross, and then calls `mark_misplaced`. The callback must mark, by
/// index, the simplified lines whose topology differs from that of the original lines.
/// Douglas-Peucker gives these lines more vertices and repeats both steps. Segment collapse never
/// changes the topology, so it does not call `mark_misplaced` at all.
using MarkMisplaced =
    std::function<void(const std::vector<Ring>& simplified, std::vector<char>& marks)>;
/// Refinement adds points to the edges of the outline and rounds them to the lattice. Returns how
/// far, in lattice steps, rounding may move a point away from its edge if the outline is to stay
/// within the tolerance. Douglas-Peucker, and any method with a tolerance of 0, reserve no part of
/// the tolerance for refinement. Refinement may then exceed the tolerance, so the result is
/// infinite.
double left_for_refinement_steps(const Lattice& lattice, const SimplificationOptions& options);

/// The largest two-sided Hausdorff distance between a contour and the ring of the same index, in
/// mm, with a relative accuracy of 1e-10. If is_open[i] is true, contour i is a line, as in
/// simplify_lines(). O(n log n) typically.
double hausdorff_mm(const Pslg& contours, const Pslg& rings, const Lattice& lattice,
                    const std::vector<bool>& is_open = {});

/// The area, in mm^2, between each contour and the ring of the same index, where the contour is
/// farther than `beyond_mm` from the ring: the sum of length times distance over the contour's
/// edges whose middle is that far away. It is exact for straight parts and an estimate elsewhere.
double moved_area_mm2(const Pslg& contours, const Pslg& rings, const Lattice& lattice,
                      double beyond_mm, const std::vector<bool>& is_open = {});

}  // namespace trocar::pipeline
