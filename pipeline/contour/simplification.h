// SPDX-License-Identifier: GPL-3.0-or-later
// Fewer vertices on the outline, within a tolerance and with the topology preserved.
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

/// One ring for each ring of `contours` (valid by check_pslg), in the same order. No ring crosses
/// another or itself or collapses, and each keeps its orientation and its place inside or outside
/// the others. With a tolerance of 0 both methods remove exactly the vertices on the line between
/// their neighbours. Douglas-Peucker keeps more vertices where it would violate the topology, down
/// to the contour itself if need be; its repair loop ends because each round adds contour vertices.
/// O(n log n) typically.
Pslg simplify(const Pslg& contours, const Lattice& lattice, const SimplificationOptions& options);

/// The same for lines that may share ends: those for which `is_open` holds keep their first and
/// last vertex, which are not joined. `mark_misplaced` is asked by Douglas-Peucker as soon as
/// nothing crosses: it marks, by index, those of the simplified lines that are still out of place,
/// which get more vertices; the collapse never puts a line out of place.
using MarkMisplaced =
    std::function<void(const std::vector<Ring>& simplified, std::vector<char>& marks)>;
Pslg simplify_lines(const Pslg& lines, const std::vector<bool>& is_open, const Lattice& lattice,
                    const SimplificationOptions& options, const MarkMisplaced& mark_misplaced);

/// How far, in lattice steps, points may be put beside the edges later without leaving the
/// tolerance; infinite where the method does not count them, and without a tolerance.
double left_for_refinement_steps(const Lattice& lattice, const SimplificationOptions& options);

/// Largest distance between each contour and the ring of the same index, either way, in mm, with
/// any vertices. Accurate to 1e-10 of itself. Those for which `is_open` holds, if it is given, are
/// lines, as in simplify_lines(). O(n log n) typically.
double hausdorff_mm(const Pslg& contours, const Pslg& rings, const Lattice& lattice,
                    const std::vector<bool>& is_open = {});

}  // namespace trocar::pipeline
