// SPDX-License-Identifier: Apache-2.0
#include "runtime/cut/delaunay_flips.h"

namespace trocar::runtime {
namespace {

// The side of u = across[t][i] that is side i of t.
std::uint32_t side_beyond(const SheetMesh& mesh, std::uint32_t t, std::uint32_t i) {
  const std::uint32_t to = mesh.triangles[t][(i + 1) % 3];
  const Triangle& u = mesh.triangles[mesh.across[t][i]];
  return u[0] == to ? 0 : u[1] == to ? 1 : 2;
}

bool is_delaunay(const SheetMesh& mesh, std::uint32_t t, std::uint32_t i) {
  const Triangle& u = mesh.triangles[mesh.across[t][i]];
  const LatticePoint apex = mesh.vertices[u[(side_beyond(mesh, t, i) + 2) % 3]];
  const auto [a, b, c] = corners(mesh, t);
  return in_circle(a, b, c, apex) <= 0;
}

void tell(SheetMesh& mesh, std::uint32_t neighbour, std::uint32_t before, std::uint32_t now,
          SheetEdit& edit) {
  if (neighbour == kNone) return;
  edit.touch_triangle(mesh, neighbour);
  for (std::uint32_t& beyond : mesh.across[neighbour]) {
    if (beyond == before) beyond = now;
  }
}

// Turns the side (a, b) between (a, b, p) and (b, a, q) into (p, q).
void flip(SheetMesh& mesh, std::uint32_t t, std::uint32_t i, SheetEdit& edit) {
  const std::uint32_t u = mesh.across[t][i], j = side_beyond(mesh, t, i);
  edit.touch_triangle(mesh, t);
  edit.touch_triangle(mesh, u);
  const Triangle old_t = mesh.triangles[t], old_u = mesh.triangles[u];
  const std::array<std::uint32_t, 3> beyond_t = mesh.across[t], beyond_u = mesh.across[u];
  const std::uint32_t a = old_t[i], b = old_t[(i + 1) % 3], p = old_t[(i + 2) % 3],
                      q = old_u[(j + 2) % 3];
  const std::uint32_t bp = beyond_t[(i + 1) % 3], pa = beyond_t[(i + 2) % 3],
                      aq = beyond_u[(j + 1) % 3], qb = beyond_u[(j + 2) % 3];
  mesh.triangles[t] = {p, a, q};
  mesh.across[t] = {pa, aq, u};
  mesh.triangles[u] = {q, b, p};
  mesh.across[u] = {qb, bp, t};
  tell(mesh, aq, u, t, edit);
  tell(mesh, bp, t, u, edit);
}

}  // namespace

void FlipSpace::allocate(std::size_t max_triangles) {
  reserve_touched(waiting, max_triangles);
  waits.allocate(max_triangles);
}

Stage restore_delaunay(SheetMesh& mesh, std::span<const TriangleSide> sides, FlipSpace& space,
                       SheetEdit& edit, std::uint32_t& flips) noexcept {
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
  for (const auto& [t, i] : sides) {
    if (!is_delaunay(mesh, t, i)) suspect(t);
  }
  while (!space.waiting.empty() && fits) {
    const std::uint32_t t = space.waiting.back();
    space.waiting.pop_back();
    *space.waits.insert(t, 0) = 0;
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t u = mesh.across[t][i];
      if (u == kNone || is_delaunay(mesh, t, i)) continue;
      flip(mesh, t, i, edit);
      ++flips;
      suspect(u);
      suspect(t);
      break;
    }
  }
  return fits ? Stage::kDone : Stage::kCapacity;
}

}  // namespace trocar::runtime
