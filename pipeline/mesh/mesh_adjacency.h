// SPDX-License-Identifier: GPL-3.0-or-later
// Which side of which triangle lies beyond which.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "formats/geometry/slice_mesh.h"

namespace trocar::pipeline {

/// A side of a triangle as one number. Side i is opposite vertex i and runs from the next vertex to
/// the one before; a triangle is on the left of its sides.
using Side = std::uint32_t;
inline constexpr Side kNoSide = 0xffffffff;
constexpr Side side_number(std::uint32_t triangle, std::uint32_t i) {
  return 4 * triangle + i;
}
constexpr std::uint32_t triangle_of(Side s) {
  return s >> 2;
}
constexpr std::uint32_t index_of(Side s) {
  return s & 3;
}

/// The next and the previous of a triangle's three vertices or sides.
constexpr std::uint32_t after(std::uint32_t i) {
  return i == 2 ? 0 : i + 1;
}
constexpr std::uint32_t before(std::uint32_t i) {
  return i == 0 ? 2 : i - 1;
}

/// By triangle and side: the same edge as a side of the triangle beyond; kNoSide at the boundary.
using Neighbours = std::vector<std::array<Side, 3>>;

/// Of a valid mesh. O(n): sides are matched among those that start at one vertex.
Neighbours neighbours(const SliceMesh& mesh);

}  // namespace trocar::pipeline
