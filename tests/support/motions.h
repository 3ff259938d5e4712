// SPDX-License-Identifier: Apache-2.0
// The motions that map the lattice onto itself, and properties of meshes and outlines that do not
// depend on the order in which they are given.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "formats/mesh/slice_mesh.h"

namespace trocar::test {

/// A rotation by a multiple of 90 degrees, then a translation.
struct Motion {
  int quarters = 0;
  LatticePoint by;

  LatticePoint operator()(LatticePoint p) const {
    for (int i = 0; i < quarters; ++i)
      p = {-p.y, p.x};
    return {p.x + by.x, p.y + by.y};
  }
  Ring operator()(Ring ring) const {
    for (LatticePoint& p : ring)
      p = (*this)(p);
    return ring;
  }
  Pslg operator()(Pslg pslg) const {
    for (Ring& ring : pslg.rings)
      ring = (*this)(ring);
    return pslg;
  }
  SliceMesh operator()(SliceMesh mesh) const {
    for (LatticePoint& p : mesh.vertices)
      p = (*this)(p);
    return mesh;
  }
};
/// Each ring from its smallest vertex, the rings in ascending order.
inline std::vector<Ring> canonical(std::vector<Ring> rings) {
  for (Ring& ring : rings)
    std::rotate(ring.begin(), std::min_element(ring.begin(), ring.end()), ring.end());
  std::sort(rings.begin(), rings.end());
  return rings;
}

using Corners = std::array<LatticePoint, 3>;
/// The triangles by their points, each from its smallest point, in ascending order.
inline std::vector<Corners> canonical(const SliceMesh& mesh) {
  std::vector<Corners> out;
  for (const Triangle& t : mesh.triangles) {
    Corners c = {mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]};
    std::rotate(c.begin(), std::min_element(c.begin(), c.end()), c.end());
    out.push_back(c);
  }
  std::sort(out.begin(), out.end());
  return out;
}

/// The edges that every Delaunay triangulation of the outline and its vertices has: those on the
/// boundary, and those whose four points are not on one circle.
inline std::vector<std::array<LatticePoint, 2>> decided_edges(const SliceMesh& mesh) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> apex;
  for (const Triangle& t : mesh.triangles) {
    for (std::size_t i = 0; i < 3; ++i)
      apex[{t[i], t[(i + 1) % 3]}] = t[(i + 2) % 3];
  }
  std::vector<std::array<LatticePoint, 2>> out;
  for (const auto& [edge, inner] : apex) {
    const auto beyond = apex.find({edge.second, edge.first});
    const LatticePoint a = mesh.vertices[edge.first], b = mesh.vertices[edge.second];
    if (beyond == apex.end() ||
        in_circle(a, b, mesh.vertices[inner], mesh.vertices[beyond->second]) != 0)
      out.push_back({a, b});
  }
  std::sort(out.begin(), out.end());
  return out;
}

/// Is there more than one Delaunay triangulation?
inline bool has_ties(const SliceMesh& mesh) {
  return decided_edges(mesh).size() != 3 * mesh.triangles.size();
}

}  // namespace trocar::test
