// SPDX-License-Identifier: Apache-2.0
#include "runtime/hole_cutting/delaunay_flips.h"

#include "formats/geometry/edge_predicates.h"
#include "formats/geometry/triangle_edge.h"

namespace trocar::runtime {
namespace {

// Returns the number that edge i of t has in the triangle beyond it.
std::uint32_t edge_beyond(const SheetMesh& mesh, std::uint32_t t, std::uint32_t i) {
  return corner_of(mesh.triangles[mesh.across[t][i]], mesh.triangles[t][next_corner(i)]);
}

bool is_delaunay(const SheetMesh& mesh, std::uint32_t t, std::uint32_t i) {
  const Triangle &v = mesh.triangles[t], &u = mesh.triangles[mesh.across[t][i]];
  return is_locally_delaunay(mesh.vertices[v[previous_corner(i)]], mesh.vertices[v[i]],
                             mesh.vertices[v[next_corner(i)]],
                             mesh.vertices[u[previous_corner(edge_beyond(mesh, t, i))]]);
}

// Replaces the neighbour's link to the triangle `before` by one to `now`.
void relink(SheetMesh& mesh, std::uint32_t neighbour, std::uint32_t before, std::uint32_t now,
            SheetEdit& edit) {
  if (neighbour == kNoSlot) return;
  edit.touch_triangle(mesh, neighbour);
  for (std::uint32_t& beyond : mesh.across[neighbour]) {
    if (beyond == before) beyond = now;
  }
}

// Replaces the edge (a, b) between (a, b, p) and (b, a, q) by (p, q).
void flip(SheetMesh& mesh, std::uint32_t t, std::uint32_t i, SheetEdit& edit) {
  const std::uint32_t u = mesh.across[t][i], j = edge_beyond(mesh, t, i);
  edit.touch_triangle(mesh, t);
  edit.touch_triangle(mesh, u);
  const Triangle old_t = mesh.triangles[t], old_u = mesh.triangles[u];
  const std::array<std::uint32_t, 3> beyond_t = mesh.across[t], beyond_u = mesh.across[u];
  const std::uint32_t a = old_t[i], b = old_t[next_corner(i)], p = old_t[previous_corner(i)],
                      q = old_u[previous_corner(j)];
  const std::uint32_t bp = beyond_t[next_corner(i)], pa = beyond_t[previous_corner(i)],
                      aq = beyond_u[next_corner(j)], qb = beyond_u[previous_corner(j)];
  mesh.triangles[t] = {p, a, q};
  mesh.across[t] = {pa, aq, u};
  mesh.triangles[u] = {q, b, p};
  mesh.across[u] = {qb, bp, t};
  relink(mesh, aq, u, t, edit);
  relink(mesh, bp, t, u, edit);
}

}  // namespace

void FlipSpace::allocate(std::size_t max_triangles) {
  reserve_touched(waiting, max_triangles);
  waits.allocate(max_triangles);
}

StageOutcome restore_delaunay(SheetMesh& mesh, std::span<const TriangleEdge> edges,
                              FlipSpace& space, SheetEdit& edit, std::uint32_t& flips) noexcept {
  space.waiting.clear();
  space.waits.clear();
  flips = 0;
  bool fits = true;
  const auto suspect = [&](std::uint32_t t) {
    std::uint32_t* waits = space.waits.insert(t, 0);
    if (waits == nullptr) {
      fits = false;
    } else if (*waits == 0) {
      *waits = 1;
      space.waiting.push_back(t);
    }
  };
  for (const auto& [t, i] : edges) {
    if (!is_delaunay(mesh, t, i)) suspect(t);
  }
  while (!space.waiting.empty() && fits) {
    const std::uint32_t t = space.waiting.back();
    space.waiting.pop_back();
    *space.waits.insert(t, 0) = 0;
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t u = mesh.across[t][i];
      if (u == kNoSlot || is_delaunay(mesh, t, i)) continue;
      flip(mesh, t, i, edit);
      ++flips;
      suspect(u);
      suspect(t);
      break;
    }
  }
  return fits ? StageOutcome::kDone : StageOutcome::kCapacity;
}

}  // namespace trocar::runtime
