// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/triangle_poly.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <set>
#include <sstream>
#include <utility>
#include <vector>

#include "pipeline/base/number_ranges.h"
#include "pipeline/triangulation/triangulation.h"

namespace trocar::pipeline {
namespace {

std::string number(double v) {
  return text_of(v, 17);
}

// Is p strictly inside the ring, or one of its vertices?
bool inside_or_vertex(const Ring& ring, LatticePoint p) {
  bool in = false;
  for (std::size_t i = 0; i < ring.size(); ++i) {
    LatticePoint a = ring[i], b = ring[(i + 1) % ring.size()];
    if (p == a) return true;
    if ((a.y > p.y) == (b.y > p.y)) continue;
    if (a.y > b.y) std::swap(a, b);
    if (orient2d(a, b, p) > 0) in = !in;
  }
  return in;
}

// Finds a point in each hole, strictly inside it and outside the islands in it. If every ring in
// the hole is reversed, the triangulation covers what is not material, and the triangles at the rim
// of the hole lie in this hole and not in a deeper one.
Result<std::vector<std::array<double, 2>>> hole_seeds(const Pslg& pslg, const Lattice& lattice) {
  std::vector<std::array<double, 2>> seeds;
  for (const Ring& hole : pslg.rings) {
    if (doubled_area(hole) > 0) continue;
    Pslg complement;
    for (const Ring& ring : pslg.rings) {
      if (!std::all_of(ring.begin(), ring.end(),
                       [&hole](LatticePoint p) { return inside_or_vertex(hole, p); }))
        continue;
      complement.rings.emplace_back(ring.rbegin(), ring.rend());
    }
    const auto triangulation = triangulate(complement);
    if (!triangulation) return triangulation.error();
    const SliceMesh& mesh = triangulation->mesh;
    std::set<std::pair<LatticePoint, LatticePoint>> rim;
    for (std::size_t i = 0; i < hole.size(); ++i)
      rim.emplace(hole[(i + 1) % hole.size()], hole[i]);
    std::int64_t best = 0;
    std::array<double, 2> seed{};
    for (const Triangle& t : mesh.triangles) {
      const std::array<LatticePoint, 3> p = {mesh.vertices[t[0]], mesh.vertices[t[1]],
                                             mesh.vertices[t[2]]};
      const bool on_rim =
          rim.contains({p[0], p[1]}) || rim.contains({p[1], p[2]}) || rim.contains({p[2], p[0]});
      if (on_rim && orient2d(p[0], p[1], p[2]) > best) {
        best = orient2d(p[0], p[1], p[2]);
        seed = {(lattice.to_mm(p[0].x) + lattice.to_mm(p[1].x) + lattice.to_mm(p[2].x)) / 3,
                (lattice.to_mm(p[0].y) + lattice.to_mm(p[1].y) + lattice.to_mm(p[2].y)) / 3};
      }
    }
    seeds.push_back(seed);
  }
  return seeds;
}

}  // namespace

Result<std::string> poly_text(const AssetSlice& slice, const Lattice& lattice) {
  const auto seeds = hole_seeds(slice.pslg, lattice);
  if (!seeds) return seeds.error();
  std::size_t n = 0;
  for (const Ring& ring : slice.pslg.rings)
    n += ring.size();
  std::ostringstream out;
  out << "# slice " << slice.index << ", mm in the slice plane\n" << n << " 2 0 1\n";
  std::size_t at = 0;
  for (const Ring& ring : slice.pslg.rings) {
    for (const LatticePoint p : ring)
      out << ++at << ' ' << number(lattice.to_mm(p.x)) << ' ' << number(lattice.to_mm(p.y))
          << " 1\n";
  }
  out << n << " 1\n";
  std::size_t first = 1, segment = 0;
  for (const Ring& ring : slice.pslg.rings) {
    for (std::size_t i = 0; i < ring.size(); ++i)
      out << ++segment << ' ' << first + i << ' ' << first + (i + 1) % ring.size() << " 1\n";
    first += ring.size();
  }
  out << seeds->size() << '\n';
  for (std::size_t i = 0; i < seeds->size(); ++i)
    out << i + 1 << ' ' << number((*seeds)[i][0]) << ' ' << number((*seeds)[i][1]) << '\n';
  return out.str();
}

}  // namespace trocar::pipeline
