// SPDX-License-Identifier: Apache-2.0
// Random polygons, the same with every standard library, and plane geometry in floating point,
// independent of the code under test.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <random>
#include <set>
#include <vector>

#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/slice_mesh.h"

namespace trocar::runtime {

// The same numbers with every standard library.
class Random {
 public:
  explicit Random(std::uint64_t seed) : bits_(seed) {}
  int between(int low, int high) {
    return low + static_cast<int>(bits_() % static_cast<std::uint64_t>(high - low + 1));
  }
  double unit() { return static_cast<double>(bits_() >> 11U) * 0x1p-53; }
  LatticePoint point(int low, int high) { return {between(low, high), between(low, high)}; }
  /// An element of a container that is not empty.
  template <typename Container>
  auto& pick(Container& from) {
    return from[bits_() % from.size()];
  }
  std::mt19937_64& bits() { return bits_; }

 private:
  std::mt19937_64 bits_;
};

inline bool is_tool(const Ring& ring) {
  if (ring.size() < 3 || !check_pslg({{ring}}) || doubled_area(ring) <= 0) return false;
  return std::set<LatticePoint>(ring.begin(), ring.end()).size() == ring.size();
}

// Rings in polar order around a centre, with random radii: convex or not. With fewer vertices, and
// larger, where the lattice is too coarse for the wanted ones.
inline Ring star(Random& random, LatticePoint centre, double low, double high, int n) {
  for (int tries = 1;; ++tries) {
    if (tries % 20 == 0 && n > 3) --n;
    if (tries % 100 == 0) high += 0.5;
    std::vector<double> angles;
    angles.reserve(static_cast<std::size_t>(n));
    for (int i = 0; i < n; ++i)
      angles.push_back(6.283185307179586 * random.unit());
    std::sort(angles.begin(), angles.end());
    Ring ring;
    for (double a : angles) {
      const double r = low + (high - low) * random.unit();
      ring.push_back({centre.x + static_cast<int>(std::lround(r * std::cos(a))),
                      centre.y + static_cast<int>(std::lround(r * std::sin(a)))});
    }
    if (is_tool(ring)) return ring;
  }
}

// Andrew's monotone chain: strictly convex.
inline Ring convex(Random& random, LatticePoint centre, int radius, int points) {
  while (true) {
    std::vector<LatticePoint> p;
    for (int i = 0; i < points; ++i) {
      const LatticePoint d = random.point(-radius, radius);
      p.push_back({centre.x + d.x, centre.y + d.y});
    }
    std::sort(p.begin(), p.end());
    Ring hull;
    for (int pass = 0; pass < 2; ++pass) {
      const std::size_t base = hull.size();
      for (LatticePoint q : p) {
        while (hull.size() >= base + 2 && orient2d(hull[hull.size() - 2], hull.back(), q) <= 0) {
          hull.pop_back();
        }
        hull.push_back(q);
      }
      hull.pop_back();
      std::reverse(p.begin(), p.end());
    }
    if (is_tool(hull)) return hull;
  }
}

// A simple polygon of a few random points, in an order that makes it simple.
inline Ring tangled(Random& random, LatticePoint centre, int radius, int n) {
  while (true) {
    Ring ring;
    for (int i = 0; i < n; ++i) {
      const LatticePoint d = random.point(-radius, radius);
      ring.push_back({centre.x + d.x, centre.y + d.y});
    }
    if (doubled_area(ring) < 0) std::reverse(ring.begin(), ring.end());
    if (is_tool(ring)) return ring;
  }
}

inline Ring any_tool(Random& random, LatticePoint centre, int radius) {
  switch (random.between(0, 2)) {
    case 0:
      return convex(random, centre, radius, random.between(3, 10));
    case 1:
      return tangled(random, centre, radius, random.between(3, 6));
    default:
      return star(random, centre, 0.3 * radius, radius, random.between(5, 12));
  }
}

// --- areas and memberships ---

using Real = long double;
using Polygon = std::vector<std::array<Real, 2>>;

// Sutherland and Hodgman: the part of a polygon to the left of ab.
inline Polygon clip(const Polygon& in, LatticePoint a, LatticePoint b) {
  auto side = [a, b](const std::array<Real, 2>& p) {
    return (Real(b.x) - a.x) * (p[1] - a.y) - (Real(b.y) - a.y) * (p[0] - a.x);
  };
  Polygon out;
  for (std::size_t i = 0; i < in.size(); ++i) {
    const auto &p = in[i], &q = in[(i + 1) % in.size()];
    const Real sp = side(p), sq = side(q);
    if (sp >= 0) out.push_back(p);
    if ((sp > 0 && sq < 0) || (sp < 0 && sq > 0)) {
      const Real t = sp / (sp - sq);
      out.push_back({p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])});
    }
  }
  return out;
}

inline Real length(LatticePoint a, LatticePoint b) {
  return std::sqrt(static_cast<Real>(distance2(a, b)));
}

inline Real distance(Real x, Real y, LatticePoint a, LatticePoint b) {
  const Real dx = Real(b.x) - a.x, dy = Real(b.y) - a.y;
  Real t = ((x - a.x) * dx + (y - a.y) * dy) / (dx * dx + dy * dy);
  t = std::clamp(t, Real(0), Real(1));
  return std::hypot(x - a.x - t * dx, y - a.y - t * dy);
}

// The winding number of the rings around a point that is not on them.
inline int winding(Real x, Real y, const std::vector<Ring>& rings) {
  int sum = 0;
  for (const Ring& ring : rings) {
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const LatticePoint a = ring[i], b = ring[(i + 1) % ring.size()];
      if ((a.y > y) == (b.y > y)) continue;
      const Real at = a.x + (y - a.y) / (Real(b.y) - a.y) * (Real(b.x) - a.x);
      if (at > x) sum += b.y > a.y ? 1 : -1;
    }
  }
  return sum;
}

inline Real nearest_edge(Real x, Real y, const std::vector<Ring>& rings) {
  Real best = 1e30L;
  for (const Ring& ring : rings) {
    for (std::size_t i = 0; i < ring.size(); ++i) {
      best = std::min(best, distance(x, y, ring[i], ring[(i + 1) % ring.size()]));
    }
  }
  return best;
}

// Bound on the doubled area that bends may move: each edge that takes part in a
// crossing of outline and tool by at most a diagonal of the lattice per crossing.
inline Real rounding_bound(const std::vector<Ring>& outline, const Ring& tool) {
  Real bound = 0;
  for (const Ring& ring : outline) {
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const LatticePoint a = ring[i], b = ring[(i + 1) % ring.size()];
      for (std::size_t j = 0; j < tool.size(); ++j) {
        const LatticePoint c = tool[j], d = tool[(j + 1) % tool.size()];
        if (segments_cross(a, b, c, d)) bound += 1.4143L * (length(a, b) + length(c, d));
      }
    }
  }
  return bound;
}

/// Twice the area that a triangle and a tool, given by its own triangles, have in common.
inline Real common_area(const std::array<LatticePoint, 3>& triangle, const SliceMesh& tool) {
  Real sum = 0;
  for (const Triangle& knife : tool.triangles) {
    Polygon polygon;
    for (const LatticePoint q : triangle)
      polygon.push_back({Real(q.x), Real(q.y)});
    for (std::size_t i = 0; i < 3 && !polygon.empty(); ++i)
      polygon = clip(polygon, tool.vertices[knife[i]], tool.vertices[knife[(i + 1) % 3]]);
    for (std::size_t i = 0; i < polygon.size(); ++i) {
      const auto &q = polygon[i], &r = polygon[(i + 1) % polygon.size()];
      sum += (q[0] - triangle[0].x) * (r[1] - triangle[0].y) -
             (q[1] - triangle[0].y) * (r[0] - triangle[0].x);
    }
  }
  return sum;
}

}  // namespace trocar::runtime
