// SPDX-License-Identifier: GPL-3.0-or-later
// Where an iso-contour crosses the grid line between two pixels, better than linear interpolation
// knows it; and how far to move the crossings so that chords enclose the area of the curve.
#pragma once

#include <array>
#include <span>

namespace trocar::pipeline {

/// Samples along a grid line less the iso-value, of which [3] and [4] are the two pixels that the
/// contour passes between: one is >= 0, the other is not. `known` are those that exist: outside
/// first .. last the image has ended. 0 <= first <= 3, 4 <= last <= 7.
struct GridLine {
  std::array<double, 8> value{};
  int first = 0, last = 7;
};

/// The crossing as a fraction in [0, 1] of the way from [3] to [4]:
///  - where the line rises from one flat to another about the middle of which the iso-value lies,
///    the edge is where a jump would have to be to leave the same sum. Pixels being averages, that
///    is exact for every straight edge, however sharp;
///  - else the crossing of the monotone cubic interpolant (Steffen, Astronomy and Astrophysics
///    239, 1990), of which there is one. It does not overshoot, and is linear where data are.
double crossing(const GridLine& line);

/// A crossing in units of pixels: on the grid line from (x, y) to the next pixel in u or in v.
struct Crossing {
  int x = 0, y = 0;
  bool along_v = false;
  bool fixed = false;  ///< at the image's border
  double t = 0;
};

/// Chords of a curve with the curvature k enclose k c^3 / 12 less than it does. Moves the crossings
/// of a closed ring (material on the left) along their grid lines, so that the polygon has the area
/// of the curve they were on: outwards where it is convex, by some hundredths of a pixel, and
/// never by more than a sixteenth. O(n).
void restore_chord_areas(std::span<Crossing> ring);

}  // namespace trocar::pipeline
