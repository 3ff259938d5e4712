// SPDX-License-Identifier: GPL-3.0-or-later
// Smooth borders between labels, given by the crossings of a border with the grid lines between
// pixels. Tested through label_borders().
// Tests: tests/pipeline/contour/label_borders_test.cpp
#pragma once

#include <optional>
#include <vector>

#include "pipeline/contour/contour_crossing.h"
#include "pipeline/contour/segment_distance.h"

namespace trocar::pipeline {

/// Least distance between a crossing and a pixel's centre, in pixels.
inline constexpr double kMinPixelDistance = 0.02;

/// The two ends of an open border, in pixels.
struct BorderEnds {
  Point from, to;
};

/// Moves the crossings of a border, which are half way between two pixels, along their grid lines
/// onto a smooth curve. The curve is the border convolved, with the index of the crossing as the
/// arc length, with the kernel 2 G(s) - G(sqrt(2) s), which keeps curvature; s is a fourteenth of
/// the border's length but at most 3 crossings. Each crossing stays on its grid line between its
/// pixels, so that nothing can cross. The areas on both sides stay the same if that is possible
/// between the pixels. `fixed` crossings do not move and divide the border. A closed border may
/// start at another crossing afterwards. O(n).
void smooth_border(std::vector<Crossing>& border, const std::optional<BorderEnds>& ends);

}  // namespace trocar::pipeline
