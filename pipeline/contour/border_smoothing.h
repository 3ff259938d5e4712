// SPDX-License-Identifier: GPL-3.0-or-later
// Smooths the borders between labels. A border is given by its crossings with the grid lines
// between pixels. Tested through label_borders().
// Tests: tests/pipeline/contour/label_borders_test.cpp
#pragma once

#include <optional>
#include <vector>

#include "pipeline/contour/contour_crossing.h"
#include "pipeline/contour/segment_distance.h"

namespace trocar::pipeline {

/// Smallest distance between a crossing and a pixel's centre, in pixels.
inline constexpr double kMinPixelDistance = 0.02;

/// The two ends of an open border, in pixels.
struct BorderEnds {
  Point from, to;
};

/// Moves the crossings of a border, which are half-way between two pixels, along their grid lines
/// onto a smooth curve. The curve is the border convolved with the kernel 2 G(s) - G(sqrt(2) s),
/// which keeps curvature; G(s) is a Gaussian of standard deviation s. Arc length is counted in
/// crossings. s is a fourteenth of the border's length, but at most 3 crossings. Each crossing
/// stays on its grid line between its two pixels, so nothing can cross. The areas on both sides
/// stay the same, if that is possible with crossings between the pixels. `fixed` crossings do not
/// move, and they divide the border. A closed border may afterwards start at another crossing.
/// O(n).
void smooth_border(std::vector<Crossing>& border, const std::optional<BorderEnds>& ends);

}  // namespace trocar::pipeline
