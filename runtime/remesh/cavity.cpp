// SPDX-License-Identifier: Apache-2.0
#include "runtime/remesh/cavity.h"

#include <algorithm>

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
bool inside(std::int64_t x, std::int64_t y, std::int64_t scale, Outline polygon) {
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

Contact contact(const std::array<LatticePoint, 3>& triangle, Outline tool) noexcept {
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

bool strictly_outside(LatticePoint p, Outline tool) noexcept {
  for (std::size_t i = 0, n = tool.size(); i < n; ++i) {
    const LatticePoint a = tool[i], b = tool[i + 1 == n ? 0 : i + 1];
    if (orient2d(a, b, p) == 0 && diametral_dot(a, b, p) <= 0) return false;
  }
  return !inside(p.x, p.y, 1, tool);
}

void Cavity::allocate(std::size_t max_triangles) {
  reserve_touched(triangles, max_triangles);
  reserve_touched(rim, 3 * max_triangles);
  reserve_touched(rim_vertices, 3 * max_triangles);
  reserve_touched(inner, 3 * max_triangles);
  members.allocate(max_triangles);
  vertices.allocate(3 * max_triangles);
}

Stage find_cavity(const SheetMesh& mesh, const TriangleGrid& grid, Outline tool,
                  Cavity& cavity) noexcept {
  cavity.triangles.clear();
  cavity.members.clear();
  bool overlaps = false, fits = true;
  grid.for_each(mesh, box_around(tool), [&](std::uint32_t t) {
    const Contact c = contact(corners(mesh, t), tool);
    if (c == Contact::kApart || !fits) return;
    overlaps = overlaps || c == Contact::kOverlaps;
    fits = push_within(cavity.triangles, t);
    if (fits) cavity.members.insert(t, 1);
  });
  if (!fits) return Stage::kCapacity;
  if (!overlaps) {
    cavity.triangles.clear();
    cavity.members.clear();
  }
  std::sort(cavity.triangles.begin(), cavity.triangles.end());
  return Stage::kDone;
}

Stage enlarge_cavity(std::span<const std::uint32_t> triangles, Cavity& cavity) noexcept {
  for (const std::uint32_t t : triangles) {
    if (cavity.contains(t)) continue;
    if (!push_within(cavity.triangles, t)) return Stage::kCapacity;
    cavity.members.insert(t, 1);
  }
  std::sort(cavity.triangles.begin(), cavity.triangles.end());
  return Stage::kDone;
}

void trace_rim(const SheetMesh& mesh, Cavity& cavity) noexcept {
  cavity.rim.clear();
  cavity.rim_vertices.clear();
  cavity.inner.clear();
  cavity.vertices.clear();
  const auto list = [&cavity](std::vector<std::uint32_t>& vertices, std::uint32_t v) {
    const std::size_t known = cavity.vertices.size();
    cavity.vertices.insert(v, 1);
    if (cavity.vertices.size() > known) vertices.push_back(v);
  };
  for (const std::uint32_t t : cavity.triangles) {
    const Triangle& v = mesh.triangles[t];
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t from = v[i], to = v[(i + 1) % 3], beyond = mesh.across[t][i];
      RimEdge edge{from, to, beyond, 0};
      if (beyond != kNone) {
        if (cavity.contains(beyond)) continue;
        const Triangle& u = mesh.triangles[beyond];
        edge.kept_side = u[0] == to ? 0 : u[1] == to ? 1 : 2;
      }
      cavity.rim.push_back(edge);
      list(cavity.rim_vertices, from);
      list(cavity.rim_vertices, to);
    }
  }
  for (const std::uint32_t t : cavity.triangles) {
    for (const std::uint32_t v : mesh.triangles[t])
      list(cavity.inner, v);
  }
}

}  // namespace trocar::runtime
