// SPDX-License-Identifier: Apache-2.0
// First stage of a cut (paper, II.C: "search all meshes that are across the
// hexagon by intersection test and all vertices inside the hexagon"): which
// triangles the tool meets, and the rim of the cavity that they leave. All
// decisions are exact in 64- and 128-bit integers.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "formats/result.h"
#include "formats/slice_mesh.h"
#include "runtime/remesh/sheet_mesh.h"

namespace trocar::runtime {

/// neighbours[t][i] is the triangle across the edge from corner i to corner
/// i + 1 (mod 3) of triangle t, kNone on the sheet's boundary.
using Neighbours = std::vector<std::array<std::uint32_t, 3>>;

/// O(n log n). Refused: an index out of range, or a directed edge used twice.
Result<Neighbours> triangle_neighbours(const SliceMesh& sheet);

enum class Contact : std::uint8_t {
  kApart,     ///< the closed triangle and the closed tool have no point in common
  kTouches,   ///< common points, all on both boundaries
  kOverlaps,  ///< a common area
};

/// How the triangle (counter-clockwise) and the tool (simple) meet. O(tool size).
Contact contact(const std::array<LatticePoint, 3>& triangle, const Ring& tool);

/// Is p neither inside the simple polygon nor on it? O(tool size).
bool strictly_outside(LatticePoint p, const Ring& tool);

/// A directed edge of the cavity's boundary, the cavity on its left.
struct RimEdge {
  std::uint32_t from, to;  ///< vertices of the sheet
  std::uint32_t kept;      ///< the triangle that stays beyond it; kNone on the sheet's boundary
};

struct Cavity {
  std::vector<std::uint32_t> triangles;  ///< ascending
  std::vector<std::uint8_t> contains;    ///< by triangle of the sheet: 1 if in the cavity
  std::vector<RimEdge> rim;              ///< in the order of `triangles`
  std::vector<std::uint32_t> inner;      ///< vertices all of whose triangles go, off the rim
};

/// The cavity that the triangles marked in `contains` leave.
Cavity make_cavity(const SliceMesh& sheet, const Neighbours& neighbours,
                   std::vector<std::uint8_t> contains);

inline std::array<LatticePoint, 3> corners(const SliceMesh& sheet, std::uint32_t t) {
  const Triangle& v = sheet.triangles[t];
  return {sheet.vertices[v[0]], sheet.vertices[v[1]], sheet.vertices[v[2]]};
}

}  // namespace trocar::runtime
