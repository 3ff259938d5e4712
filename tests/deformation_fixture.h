// SPDX-License-Identifier: Apache-2.0
// Sheets and tools for the tests of runtime/deformation, and the three scans' assets where there
// are such.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "formats/asset.h"
#include "runtime/deformation/network.h"

namespace trocar::test {

/// The corners of a regular polygon, counter-clockwise.
inline Ring regular_polygon(LatticePoint centre, double circumradius, int sides, double turn = 0) {
  Ring out;
  for (int k = 0; k < sides; ++k) {
    const double angle = turn + 2 * std::numbers::pi * k / sides;
    out.push_back(
        {centre.x + static_cast<std::int32_t>(std::lrint(circumradius * std::cos(angle))),
         centre.y + static_cast<std::int32_t>(std::lrint(circumradius * std::sin(angle)))});
  }
  return out;
}

/// The sheet around a round tool, as a polar grid: `sides` along the tool, `rings` of triangles
/// whose circles grow geometrically from `inner` to `outer` steps. The first `sides` vertices are
/// the tool's, the last the rim's.
inline SliceMesh polar_mesh(double inner, double outer, int sides, int rings) {
  SliceMesh mesh;
  for (int r = 0; r <= rings; ++r) {
    const double radius = inner * std::pow(outer / inner, static_cast<double>(r) / rings);
    for (const LatticePoint p :
         regular_polygon({}, radius, sides, (r % 2) * std::numbers::pi / sides))
      mesh.vertices.push_back(p);
  }
  const auto at = [&](int r, int k) { return static_cast<std::uint32_t>(r * sides + k % sides); };
  for (int r = 0; r < rings; ++r) {
    for (int k = 0; k < sides; ++k) {
      // Every other circle is turned by half a side.
      if (r % 2 == 0) {
        mesh.triangles.push_back({at(r, k), at(r + 1, k), at(r, k + 1)});
        mesh.triangles.push_back({at(r, k + 1), at(r + 1, k), at(r + 1, k + 1)});
      } else {
        mesh.triangles.push_back({at(r, k), at(r + 1, k), at(r + 1, k + 1)});
        mesh.triangles.push_back({at(r, k), at(r + 1, k + 1), at(r, k + 1)});
      }
    }
  }
  return mesh;
}

/// Uniform in [0, 1), the same on every standard library.
inline double uniform(std::mt19937_64& random) {
  return std::ldexp(static_cast<double>(random() >> 11), -53);
}

}  // namespace trocar::test
