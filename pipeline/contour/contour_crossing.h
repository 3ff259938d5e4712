// SPDX-License-Identifier: GPL-3.0-or-later
// Finds the point at which an iso-contour crosses a grid line, which joins the centres of two
// neighbouring pixels. The result is more accurate than linear interpolation. Also moves such
// crossings so that the polygon through them has the area that the curve encloses.
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
///  - The samples rise or fall monotonically from one constant value to another, and the iso-value
///    is about half-way between the two constants. The samples are then those of a blurred edge.
///    Each pixel is the average over its area, so the sum of the samples says where a sharp
///    straight edge lies, exactly. The crossing is the position of the sharp edge whose samples
///    have the same sum.
///  - Otherwise a cubic interpolates between samples 3 and 4 (Steffen, Astronomy and Astrophysics
///    239, 1990), and the crossing is its only zero there. The cubic is monotone, and linear if the
///    samples are linear.
double crossing(const GridLine& line);

/// A crossing on the grid line from pixel (x, y) to the next pixel in u, or in v if `along_v` is
/// true. It lies at the fraction t of the way.
struct Crossing {
  int x = 0, y = 0;
  bool along_v = false;
  bool fixed = false;  ///< true if the crossing must not move, as at the image's border
  double t = 0;
};

/// Moves the crossings of a closed ring (material on the left) along their grid lines. At first the
/// crossings lie on a smooth curve. Afterwards the polygon through them has the area that this
/// curve encloses. A chord of length c cuts an area of k c^3 / 12 off a curve of curvature k.
/// Crossings therefore move outwards where the curve is convex. They move by some hundredths of a
/// pixel, at most by a sixteenth. O(n).
void restore_chord_areas(std::span<Crossing> ring);

}  // namespace trocar::pipeline
