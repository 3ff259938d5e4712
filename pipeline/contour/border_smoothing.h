// SPDX-License-Identifier: GPL-3.0-or-later
// Smooth borders between labels: where a border crosses the grid lines between pixels.
#pragma once

#include <optional>
#include <vector>

#include "pipeline/contour/contour_crossing.h"
#include "pipeline/contour/segment_distance.h"

namespace trocar::pipeline {

/// How near to a pixel's centre a crossing may come, in pixels.
inline constexpr double kNearestToPixel = 0.02;

/// The points, in pixels, at which a border that is not closed ends.
struct BorderEnds {
  Point from, to;
};

/// Moves the crossings of a border, which are half way between two pixels, along their grid lines,
/// onto a smooth curve: along the arc, in crossings, by the kernel 2 G(s) - G(sqrt(2) s), which
/// keeps curvature, s = 3 or a fourteenth of the border. Each crossing stays on its grid line
/// between its pixels, so that nothing can cross; the area on either side stays too, if that is
/// possible between the pixels. `fixed` crossings divide the border and stay; a closed border may
/// begin elsewhere afterwards. O(n).
void smooth_border(std::vector<Crossing>& border, const std::optional<BorderEnds>& ends);

}  // namespace trocar::pipeline
