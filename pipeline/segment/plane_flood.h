// SPDX-License-Identifier: GPL-3.0-or-later
// Finds the regions of a plane of pixels that a disc cannot enter from outside.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace trocar::pipeline {

/// Positions of the pixels' columns and rows in mm, ascending; they need not be evenly spaced.
struct PlaneGrid {
  std::span<const double> u_mm, v_mm;
  std::size_t size() const { return u_mm.size() * v_mm.size(); }
};

/// Squared distance in mm^2 from each pixel's centre to the nearest pixel of `set` (row-major,
/// nonzero); infinite if the set is empty. Exact up to rounding. O(pixels). (P. Felzenszwalb, D.
/// Huttenlocher, Distance transforms of sampled functions, Theory of Computing 8, 2012.)
void squared_distances(const PlaneGrid& grid, std::span<const std::uint8_t> set,
                       std::vector<float>& squared_mm2);
/// The same in a volume. `at_mm` has the positions of the voxels along x, y and z.
void squared_distances(const std::array<std::vector<double>, 3>& at_mm,
                       std::span<const std::uint8_t> set, std::vector<float>& squared_mm2);

/// How `solid` encloses a pixel of find_enclosed().
enum Enclosure : std::uint8_t {
  kNotEnclosed = 0,
  kInCrevice = 1,   ///< in a region connected with the border that is too narrow for the disc
  kBehindGap = 2,   ///< in a region in which the disc fits, but into which it cannot come
  kSurrounded = 3,  ///< in a region that is not connected with the border
};

/// Finds the pixels that `solid` (row-major, nonzero) encloses. Sets `enclosed` to the Enclosure of
/// each pixel.
///
/// A disc of radius `radius_mm` moves in from the plane's border without touching `solid`. The
/// pixels outside `solid` that it never covers form regions (connected by edges). The pixels of a
/// region are enclosed if its area is at most `largest_mm2`. A gap of up to twice the radius is
/// therefore treated as closed. With radius 0, the regions are those that are not connected to the
/// border. If `near_mm2` is given, it receives squared_distances() of `solid`, but distances beyond
/// `near_mm` may be infinite. O(pixels * (1 + max(radius_mm, near_mm) / spacing)).
///
/// Method: the background is eroded by the disc and flooded from the border; then the flooded
/// pixels are dilated. (It would be wrong to flood the background that a morphological closing of
/// `solid` leaves. This background consists of discs, and the flood would leak in where a disc
/// inside touches a disc outside.)
void find_enclosed(const PlaneGrid& grid, std::span<const std::uint8_t> solid, double radius_mm,
                   double largest_mm2, std::vector<std::uint8_t>& enclosed, double near_mm = 0,
                   std::vector<float>* near_mm2 = nullptr);

}  // namespace trocar::pipeline
