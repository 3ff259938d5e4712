// SPDX-License-Identifier: Apache-2.0
// The numbering of a triangle's edges, the same in every mesh:
//
//   Edge i of a triangle runs from corner i to corner i + 1 (mod 3). The triangle lies on the left
//   of the edge. Corner i + 2 (mod 3), the apex, lies opposite the edge.
//
//            2
//           / \                     Triangle corners are counter-clockwise, so the triangle beyond
//   edge 2 /   \ edge 1             an edge has the same two vertices in the opposite order.
//         0-----1
//          edge 0
#pragma once

#include <cstdint>

#include "formats/geometry/slice_mesh.h"

namespace trocar {

/// next_corner(i) is (i + 1) mod 3 and previous_corner(i) is (i + 2) mod 3, for corners and edges.
/// A table of two-bit digits avoids a branch that a processor cannot predict.
constexpr std::uint32_t next_corner(std::uint32_t i) noexcept {
  return (0b00'10'01U >> (2 * i)) & 3;
}
constexpr std::uint32_t previous_corner(std::uint32_t i) noexcept {
  return (0b01'00'10U >> (2 * i)) & 3;
}

/// The number of the triangle's corner at vertex v. The triangle's edge that starts at v has the
/// same number. Precondition: v is a vertex of the triangle.
constexpr std::uint32_t corner_of(const Triangle& triangle, std::uint32_t v) noexcept {
  return triangle[0] == v ? 0 : triangle[1] == v ? 1 : 2;
}

/// One edge of one triangle.
struct TriangleEdge {
  std::uint32_t triangle, edge;
};

/// A TriangleEdge as one number. Triangle numbers must be below 2^29. kNoEdge stands for no edge.
using EdgeId = std::uint32_t;
inline constexpr EdgeId kNoEdge = 0xffffffff;
constexpr EdgeId edge_id(std::uint32_t triangle, std::uint32_t edge) noexcept {
  return 4 * triangle + edge;
}
constexpr std::uint32_t triangle_of(EdgeId e) noexcept {
  return e >> 2;
}
constexpr std::uint32_t index_of(EdgeId e) noexcept {
  return e & 3;
}

}  // namespace trocar
