// SPDX-License-Identifier: GPL-3.0-or-later
// Finds the point at which an iso-contour crosses the grid line between two pixels, more accurately
// than linear interpolation. Also moves these crossings so that the chords between them enclose the
// area of the curve.
#pragma once

#include <array>
#include <span>

namespace trocar::pipeline {

/// Eight samples along a grid line, each minus the iso-value. The contour passes between value[3]
/// and value[4], exactly one of which is >= 0. Only the samples with the indices `first` to `last`
/// lie in the image, with 0 <= first <= 3 and 4 <= last <= 7.
struct GridLine {
  std::array<double, 8> value{};
  int first = 0, last = 7;
};

/// The crossing as a fraction in [0, 1] of the way from sample 3 to sample 4. There are two cases:
///  - If the samples go monotonically from one constant value to another, and the iso-value
///    is about half-way between these, the crossing is the position of a jump that gives the
///    same sum of samples. As pixels are averages over their area, this is exact for every
///    sharp straight edge.
///  - Otherwise it is the only crossing of the monotone cubic interpolant (Steffen, Astronomy and
///    Astrophysics 239, 1990), which does not overshoot and is linear if the samples are linear.
double crossing(const GridLine& line);

/// A crossing, in pixels. It lies on the grid line from pixel (x, y) to the next pixel in u or in
/// v, at the fraction t of the way.
struct Crossing {
  int x = 0, y = 0;
  bool along_v = false;
  bool fixed = false;  ///< true: it does not move, for example at the image's border
  double t = 0;
};

/// Moves the crossings of a closed ring (material on the left) along their grid lines, so that the
/// polygon has the area of the curve on which the crossings lay. A chord of length c cuts an area
/// of k c^3 / 12 off a curve of curvature k. Crossings therefore move outwards where the curve is
/// convex, by some hundredths of a pixel and at most a sixteenth. O(n).
void restore_chord_areas(std::span<Crossing> ring);

}  // namespace trocar::pipeline
