// SPDX-License-Identifier: GPL-3.0-or-later
// Smooths the borders between labels. A border is given by its crossings, the points at which it
// crosses grid lines. A grid line joins the centres of two neighbouring pixels.
#pragma once

#include <optional>
#include <vector>

#include "pipeline/contour/contour_crossing.h"
#include "pipeline/contour/segment_distance.h"

namespace trocar::pipeline {

/// Smallest distance between a smoothed crossing and the centre of either of its two pixels, in
/// pixels.
inline constexpr double kMinPixelDistance = 0.02;

/// The two ends of an open border, in pixels.
struct BorderEnds {
  Point from, to;
};

/// Moves the crossings of a border along their grid lines onto a smooth curve. Crossings that are
/// `fixed` do not move. They divide the border into sections, each of which is smoothed by itself;
/// a section of fewer than 6 crossings stays as it is. Precondition: every crossing that is not
/// fixed lies half-way between its two pixels.
///
/// The curve is the section convolved with the kernel 2 G(s) - G(sqrt(2) s), which keeps curvature.
/// G(s) is a Gaussian with standard deviation s along the section. Lengths are counted in
/// crossings: s is a fourteenth of the section's length, but at most 3 crossings. Each crossing
/// stays between its two pixels, so borders cannot cross. The areas on both sides of the border
/// stay the same if the crossings can move far enough for this between their pixels. For a closed
/// border `ends` has no value. If a closed border has fixed crossings, it starts at one of them
/// after the call. O(n).
void smooth_border(std::vector<Crossing>& border, const std::optional<BorderEnds>& ends);

}  // namespace trocar::pipeline
