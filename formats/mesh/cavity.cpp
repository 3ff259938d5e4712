// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/cavity.h"

namespace trocar {
namespace {

// Classifies the intersection of the segment cd with the triangle. Two convex polygons are apart if
// and only if the line through an edge of one of them separates them strictly; their interiors are
// apart if and only if such a line separates them, not necessarily strictly.
ToolIntersection segment_contact(const std::array<LatticePoint, 3>& triangle, LatticePoint c,
                                 LatticePoint d) {
  bool overlaps = true;
  for (std::uint32_t i = 0; i < 3; ++i) {
    const LatticePoint a = triangle[i], b = triangle[next_corner(i)];
    const std::int64_t innermost = std::max(orient2d(a, b, c), orient2d(a, b, d));
    if (innermost < 0) return ToolIntersection::kApart;
    overlaps = overlaps && innermost > 0;
  }
  const auto [low, high] = std::minmax(
      {orient2d(c, d, triangle[0]), orient2d(c, d, triangle[1]), orient2d(c, d, triangle[2])});
  if (low > 0 || high < 0) return ToolIntersection::kApart;
  return overlaps && low < 0 && high > 0 ? ToolIntersection::kOverlaps : ToolIntersection::kTouches;
}

// Returns true if the point (x, y) / scale is inside the polygon. The point must not lie on the
// polygon's boundary. The test is the even-odd rule with a ray to the right.
bool inside(std::int64_t x, std::int64_t y, std::int64_t scale,
            std::span<const OutlineEdge> polygon) {
  bool in = false;
  for (const auto& [a, b, box] : polygon) {
    const std::int64_t ay = scale * a.y - y, by = scale * b.y - y;
    if ((ay > 0) == (by > 0)) continue;
    const std::int64_t ax = scale * a.x - x, bx = scale * b.x - x;
    const Int128 orientation = Int128{ax} * by - Int128{ay} * bx;
    if ((by > ay) == (orientation > 0)) in = !in;
  }
  return in;
}

OutlineEdge edge_of(Outline tool, std::size_t i) {
  const LatticePoint a = tool[i], b = tool[i + 1 == tool.size() ? 0 : i + 1];
  return {a, b, box_around(a, b)};
}

}  // namespace

ToolIntersection intersect_tool(const std::array<LatticePoint, 3>& triangle,
                                std::span<const OutlineEdge> tool) noexcept {
  const LatticeBox own = box_around(triangle);
  bool touches = false;
  for (const auto& [c, d, box] : tool) {
    if (apart(own, box)) continue;
    const ToolIntersection one = segment_contact(triangle, c, d);
    if (one == ToolIntersection::kOverlaps) return one;
    touches = touches || one == ToolIntersection::kTouches;
  }
  // No tool edge enters the open triangle, so the triangle lies entirely inside or
  // outside the tool.
  if (!touches) {
    return inside(triangle[0].x, triangle[0].y, 1, tool) ? ToolIntersection::kOverlaps
                                                         : ToolIntersection::kApart;
  }
  const std::int64_t x3 = std::int64_t{triangle[0].x} + triangle[1].x + triangle[2].x;
  const std::int64_t y3 = std::int64_t{triangle[0].y} + triangle[1].y + triangle[2].y;
  return inside(x3, y3, 3, tool) ? ToolIntersection::kOverlaps : ToolIntersection::kTouches;
}

bool strictly_outside(LatticePoint p, std::span<const OutlineEdge> tool) noexcept {
  for (const auto& [a, b, box] : tool) {
    if (is_on_segment(a, b, p)) return false;
  }
  return !inside(p.x, p.y, 1, tool);
}

void Cavity::allocate(std::size_t max_triangles) {
  reserve_touched(tool, kMaxToolCorners);
  reserve_touched(near_tool, max_triangles);
  reserve_touched(triangles, max_triangles);
  reserve_touched(boundary, 3 * max_triangles);
  reserve_touched(boundary_vertices, 3 * max_triangles);
  reserve_touched(inner, 3 * max_triangles);
  members.allocate(max_triangles);
  vertices.allocate(3 * max_triangles);
}

StageOutcome find_cavity(const SheetMesh& mesh, const TriangleGrid& grid, Outline tool,
                         Cavity& cavity) noexcept {
  cavity.triangles.clear();
  cavity.members.clear();
  cavity.tool.clear();
  for (std::size_t i = 0, n = tool.size(); i < n; ++i) {
    if (!push_within(cavity.tool, edge_of(tool, i))) return StageOutcome::kCapacity;
  }
  // In a large sheet none of this data is in the cache, so all of it is prefetched before
  // the first use.
  cavity.near_tool.clear();
  bool overlaps = false, fits = true;
  cavity.tool_box = box_around(tool);
  grid.for_each(mesh, cavity.tool_box, [&](std::uint32_t t) {
    __builtin_prefetch(&mesh.triangles[t]);
    __builtin_prefetch(&mesh.across[t]);
    fits = fits && push_within(cavity.near_tool, t);
  });
  if (!fits) return StageOutcome::kCapacity;
  for (const std::uint32_t t : cavity.near_tool) {
    for (const std::uint32_t v : mesh.triangles[t])
      __builtin_prefetch(&mesh.vertices[v]);
  }
  for (const std::uint32_t t : cavity.near_tool) {
    const ToolIntersection c = intersect_tool(corners(mesh, t), cavity.tool);
    if (c == ToolIntersection::kApart) continue;
    overlaps = overlaps || c == ToolIntersection::kOverlaps;
    cavity.triangles.push_back(t);
    cavity.members.insert(t, 1);
  }
  if (!overlaps) {
    cavity.triangles.clear();
    cavity.members.clear();
  }
  std::sort(cavity.triangles.begin(), cavity.triangles.end());
  return StageOutcome::kDone;
}

StageOutcome enlarge_cavity(std::span<const std::uint32_t> triangles, Cavity& cavity) noexcept {
  for (const std::uint32_t t : triangles) {
    if (cavity.contains(t)) continue;
    if (!push_within(cavity.triangles, t)) return StageOutcome::kCapacity;
    cavity.members.insert(t, 1);
  }
  std::sort(cavity.triangles.begin(), cavity.triangles.end());
  return StageOutcome::kDone;
}

void trace_boundary(const SheetMesh& mesh, Cavity& cavity) noexcept {
  cavity.boundary.clear();
  cavity.boundary_vertices.clear();
  cavity.inner.clear();
  cavity.vertices.clear();
  const auto on_boundary = [&cavity](std::uint32_t v) {
    const auto fresh = static_cast<std::uint32_t>(cavity.boundary_vertices.size());
    const std::uint32_t at = *cavity.vertices.insert(v, fresh);
    if (at == fresh) cavity.boundary_vertices.push_back(v);
    return at;
  };
  for (const std::uint32_t t : cavity.triangles) {
    const Triangle& v = mesh.triangles[t];
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t to = v[next_corner(i)], beyond = mesh.across[t][i];
      std::uint32_t kept_edge = 0;
      if (beyond != kNoSlot) {
        if (cavity.contains(beyond)) continue;
        kept_edge = corner_of(mesh.triangles[beyond], to);
      }
      const std::uint32_t from = on_boundary(v[i]);
      cavity.boundary.push_back({from, on_boundary(to), beyond, kept_edge});
    }
  }
  for (const std::uint32_t t : cavity.triangles) {
    for (const std::uint32_t v : mesh.triangles[t]) {
      const std::size_t known = cavity.vertices.size();
      cavity.vertices.insert(v, Cavity::kInner);
      if (cavity.vertices.size() > known) cavity.inner.push_back(v);
    }
  }
}

}  // namespace trocar
