// SPDX-License-Identifier: Apache-2.0
#include "runtime/remesh/cavity.h"

#include <algorithm>
#include <string>
#include <tuple>
#include <utility>

namespace trocar::runtime {
namespace {

enum class Kind { kClosed, kOpen };

// Has the segment cd a point in the triangle? kClosed: closed segment and closed
// triangle; kOpen: open segment and open triangle. On the segment's parameter t
// each side of the triangle is a linear condition f(t) > 0 (or >= 0), so the
// answer is whether an intersection of intervals is empty. |f| <= 2^61, hence
// the products below stay under 2^124.
bool segment_meets(const std::array<LatticePoint, 3>& triangle, LatticePoint c, LatticePoint d,
                   Kind kind) {
  Int128 low_n = 0, low_d = 1, high_n = 1, high_d = 1;
  for (std::size_t i = 0; i < 3; ++i) {
    const LatticePoint a = triangle[i], b = triangle[(i + 1) % 3];
    const std::int64_t at_c = orient2d(a, b, c), at_d = orient2d(a, b, d);
    if (at_c == at_d) {
      if (at_c < 0 || (kind == Kind::kOpen && at_c == 0)) return false;
    } else if (at_d > at_c) {  // t from -at_c / (at_d - at_c) on
      const Int128 n = -Int128{at_c}, m = Int128{at_d} - at_c;
      if (n * low_d > low_n * m) low_n = n, low_d = m;
    } else {  // t up to at_c / (at_c - at_d)
      const Int128 n = at_c, m = Int128{at_c} - at_d;
      if (n * high_d < high_n * m) high_n = n, high_d = m;
    }
  }
  const Int128 low = low_n * high_d, high = high_n * low_d;
  return kind == Kind::kOpen ? low < high : low <= high;
}

// Is the point (x, y) / scale inside the polygon? It is not on it. Even-odd
// rule with a ray to the right.
bool inside(std::int64_t x, std::int64_t y, std::int64_t scale, const Ring& polygon) {
  bool in = false;
  for (std::size_t i = 0, n = polygon.size(); i < n; ++i) {
    const LatticePoint a = polygon[i], b = polygon[i + 1 == n ? 0 : i + 1];
    const Int128 ax = scale * a.x - x, ay = scale * a.y - y;
    const Int128 bx = scale * b.x - x, by = scale * b.y - y;
    if ((ay > 0) == (by > 0)) continue;
    const Int128 turn = ax * by - ay * bx;
    if ((by > ay) == (turn > 0)) in = !in;
  }
  return in;
}

bool boxes_apart(const std::array<LatticePoint, 3>& t, LatticePoint c, LatticePoint d) {
  const auto [lx, hx] = std::minmax(c.x, d.x);
  const auto [ly, hy] = std::minmax(c.y, d.y);
  return std::min({t[0].x, t[1].x, t[2].x}) > hx || std::max({t[0].x, t[1].x, t[2].x}) < lx ||
         std::min({t[0].y, t[1].y, t[2].y}) > hy || std::max({t[0].y, t[1].y, t[2].y}) < ly;
}

}  // namespace

Result<Neighbours> triangle_neighbours(const SliceMesh& sheet) {
  struct Edge {
    std::uint32_t low, high, forward, triangle, corner;
    auto key() const { return std::tuple{low, high, forward}; }
  };
  std::vector<Edge> edges;
  edges.reserve(sheet.triangles.size() * 3);
  for (std::uint32_t t = 0; t < sheet.triangles.size(); ++t) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t from = sheet.triangles[t][i], to = sheet.triangles[t][(i + 1) % 3];
      if (from >= sheet.vertices.size()) {
        return refused("triangle " + std::to_string(t) + " names vertex " + std::to_string(from) +
                       " of " + std::to_string(sheet.vertices.size()));
      }
      edges.push_back({std::min(from, to), std::max(from, to), from < to, t, i});
    }
  }
  std::sort(edges.begin(), edges.end(),
            [](const Edge& a, const Edge& b) { return a.key() < b.key(); });
  Neighbours neighbours(sheet.triangles.size(), {kNone, kNone, kNone});
  for (std::size_t i = 0; i + 1 < edges.size(); ++i) {
    const Edge &a = edges[i], &b = edges[i + 1];
    if (a.low != b.low || a.high != b.high) continue;
    if (a.forward == b.forward) {
      return refused("triangles " + std::to_string(a.triangle) + " and " +
                     std::to_string(b.triangle) + " use an edge in the same direction");
    }
    neighbours[a.triangle][a.corner] = b.triangle;
    neighbours[b.triangle][b.corner] = a.triangle;
  }
  return neighbours;
}

Contact contact(const std::array<LatticePoint, 3>& triangle, const Ring& tool) {
  bool touches = false;
  for (std::size_t i = 0, n = tool.size(); i < n; ++i) {
    const LatticePoint c = tool[i], d = tool[i + 1 == n ? 0 : i + 1];
    if (boxes_apart(triangle, c, d) || !segment_meets(triangle, c, d, Kind::kClosed)) continue;
    if (segment_meets(triangle, c, d, Kind::kOpen)) return Contact::kOverlaps;
    touches = true;
  }
  // No tool edge enters the open triangle: it lies inside the tool, or outside.
  const std::int64_t x3 = std::int64_t{triangle[0].x} + triangle[1].x + triangle[2].x;
  const std::int64_t y3 = std::int64_t{triangle[0].y} + triangle[1].y + triangle[2].y;
  if (inside(x3, y3, 3, tool)) return Contact::kOverlaps;
  return touches ? Contact::kTouches : Contact::kApart;
}

bool strictly_outside(LatticePoint p, const Ring& tool) {
  for (std::size_t i = 0, n = tool.size(); i < n; ++i) {
    const LatticePoint a = tool[i], b = tool[i + 1 == n ? 0 : i + 1];
    if (orient2d(a, b, p) == 0 && diametral_dot(a, b, p) <= 0) return false;
  }
  return !inside(p.x, p.y, 1, tool);
}

Cavity make_cavity(const SliceMesh& sheet, const Neighbours& neighbours,
                   std::vector<std::uint8_t> contains) {
  Cavity cavity;
  cavity.contains = std::move(contains);
  std::vector<std::uint32_t> all, on_rim;
  for (std::uint32_t t = 0; t < sheet.triangles.size(); ++t) {
    if (cavity.contains[t] == 0) continue;
    cavity.triangles.push_back(t);
    const Triangle& v = sheet.triangles[t];
    all.insert(all.end(), v.begin(), v.end());
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t beyond = neighbours[t][i];
      if (beyond != kNone && cavity.contains[beyond] != 0) continue;
      cavity.rim.push_back({v[i], v[(i + 1) % 3], beyond});
      on_rim.push_back(v[i]);
      on_rim.push_back(v[(i + 1) % 3]);
    }
  }
  for (std::vector<std::uint32_t>* list : {&all, &on_rim}) {
    std::sort(list->begin(), list->end());
    list->erase(std::unique(list->begin(), list->end()), list->end());
  }
  std::set_difference(all.begin(), all.end(), on_rim.begin(), on_rim.end(),
                      std::back_inserter(cavity.inner));
  return cavity;
}

}  // namespace trocar::runtime
