// SPDX-License-Identifier: Apache-2.0
#include "runtime/deformation/part.h"

#include <algorithm>
#include <limits>

#include "runtime/sheet_mesh/flat_table.h"

namespace trocar::runtime {
namespace {

constexpr std::size_t kFirstCapacity = 128;  // the table of a part with more triangles is made anew
static_assert(FlatTable::kAbsent == kNoSlot);

Eigen::Vector2d relative(LatticePoint p, const Eigen::Vector2d& centre) {
  return Eigen::Vector2d(p.x, p.y) - centre;
}

/// Squared distance of a triangle from the origin.
double distance2_to_origin(const std::array<Eigen::Vector2d, 3>& p) {
  double least = std::numeric_limits<double>::infinity();
  bool inside = true;
  for (std::size_t k = 0; k < 3; ++k) {
    const Eigen::Vector2d& a = p[k];
    const Eigen::Vector2d edge = p[(k + 1) % 3] - a;
    inside = inside && a.x() * edge.y() - a.y() * edge.x() >= 0;
    const double t = std::clamp(-a.dot(edge) / edge.squaredNorm(), 0.0, 1.0);
    least = std::min(least, (a + t * edge).squaredNorm());
  }
  return inside ? 0 : least;
}

}  // namespace

Circle circle_around(const Ring& tool) noexcept {
  Circle circle;
  for (const LatticePoint& p : tool)
    circle.centre += Eigen::Vector2d(p.x, p.y) / static_cast<double>(tool.size());
  for (const LatticePoint& p : tool)
    circle.radius = std::max(circle.radius, relative(p, circle.centre).norm());
  return circle;
}

SheetPart part_around(const SheetMesh& sheet, std::span<const std::uint32_t> seeds,
                      const Circle& circle, double radius, std::vector<std::uint32_t>& queue) {
  FlatTable taken;  // maps the slot of a triangle to its index in the queue
  taken.allocate(kFirstCapacity);
  queue.clear();
  const auto take = [&](std::uint32_t t) {
    const auto number = static_cast<std::uint32_t>(queue.size());
    queue.push_back(t);
    if (taken.insert(t, number) != nullptr) return;
    taken.allocate(4 * queue.size());
    for (std::uint32_t k = 0; k <= number; ++k)
      taken.insert(queue[k], k);
  };
  for (std::uint32_t t : seeds) {
    if (!taken.contains(t)) take(t);
  }
  const double reach = circle.radius + radius;
  for (std::size_t k = 0; k < queue.size(); ++k) {
    for (std::uint32_t u : sheet.across[queue[k]]) {
      if (u == kNoSlot || taken.contains(u)) continue;
      const std::array<LatticePoint, 3> p = corners(sheet, u);
      if (!(distance2_to_origin({relative(p[0], circle.centre), relative(p[1], circle.centre),
                                 relative(p[2], circle.centre)}) < reach * reach))
        continue;
      take(u);
    }
  }

  // Neighbours are given by their index in the queue. Each fan of triangles gets its own vertex: if
  // the border passes through a vertex twice, the part contains that vertex twice.
  const auto n = static_cast<std::uint32_t>(queue.size());
  SheetPart part;
  std::vector<std::array<std::uint32_t, 3>>& across = part.across;
  across.resize(n);
  part.mesh.triangles.assign(n, kFreeSlot);
  for (std::uint32_t k = 0; k < n; ++k) {
    const std::uint32_t t = queue[k];
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t u = sheet.across[t][i];
      across[k][i] = u == kNoSlot ? kNoSlot : taken.find(u);
      if (u != kNoSlot && across[k][i] == kNoSlot) {
        part.outer.push_back({sheet.vertices[sheet.triangles[t][i]],
                              sheet.vertices[sheet.triangles[t][(i + 1) % 3]]});
      }
    }
  }
  for (std::uint32_t k = 0; k < n; ++k) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      if (part.mesh.triangles[k][i] != kNoSlot) continue;
      const std::uint32_t slot = sheet.triangles[queue[k]][i];
      const auto vertex = static_cast<std::uint32_t>(part.mesh.vertices.size());
      part.mesh.vertices.push_back(sheet.vertices[slot]);
      part.parent.push_back(slot);
      // Walk around the vertex, across the edge that ends in it, until the fan closes or the border
      // is reached. If it was the border, walk in the other direction, too.
      std::uint32_t t = k, corner = i;
      const auto number = [&] { part.mesh.triangles[t][corner] = vertex; };
      const auto step = [&](std::uint32_t edge) {
        t = across[t][edge];
        if (t == kNoSlot) return false;
        const Triangle& next = sheet.triangles[queue[t]];
        corner = next[0] == slot ? 0 : next[1] == slot ? 1 : 2;
        return t != k;
      };
      for (number(); step((corner + 2) % 3);)
        number();
      if (t == k) continue;
      t = k;
      for (corner = i; step(corner);)
        number();
    }
  }
  std::sort(part.outer.begin(), part.outer.end());
  return part;
}

SheetMesh to_sheet(const SheetPart& part, std::size_t spare_vertices, std::size_t spare_triangles) {
  SheetMesh out;
  out.vertices = part.mesh.vertices;
  out.triangles = part.mesh.triangles;
  out.across = part.across;
  out.add_slots(spare_vertices, spare_triangles);
  return out;
}

}  // namespace trocar::runtime
