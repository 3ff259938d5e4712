// SPDX-License-Identifier: GPL-3.0-or-later
// What a disc cannot reach from outside in a plane of pixels.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace trocar::pipeline {

/// Positions of the pixels' columns and rows in mm, ascending; they need not be evenly spaced.
struct PlaneGrid {
  std::span<const double> u_mm, v_mm;
  std::size_t size() const { return u_mm.size() * v_mm.size(); }
};

/// Squared distance in mm^2 from each pixel's centre to the nearest pixel of `set` (row-major, !=
/// 0); infinite if there is none. Exact up to rounding. O(pixels). (P. Felzenszwalb, D.
/// Huttenlocher, Distance transforms of sampled functions, Theory of Computing 8, 2012.)
void squared_distances(const PlaneGrid& grid, std::span<const std::uint8_t> set,
                       std::vector<float>& squared_mm2);

/// Finds what is enclosed by `solid` (row-major, != 0): pixels outside of it that a disc of radius
/// `radius_mm` does not cover while it moves, without touching `solid`, from the plane's border; in
/// patches of at most `largest_mm2` (connected by edges; a pixel's area is that of its cell). So a
/// gap of up to twice the radius counts as closed. Radius 0: what is not connected to the border.
///
/// The flood runs in the background eroded by the disc, and only what it reached is dilated: a test
/// of connectivity after a morphological closing would leak where an inner and an outer disc touch.
/// `enclosed` becomes 1 there, else 0. O(pixels).
void find_enclosed(const PlaneGrid& grid, std::span<const std::uint8_t> solid, double radius_mm,
                   double largest_mm2, std::vector<std::uint8_t>& enclosed);

}  // namespace trocar::pipeline
