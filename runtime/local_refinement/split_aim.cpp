// SPDX-License-Identifier: Apache-2.0
#include "runtime/local_refinement/split_aim.h"

#include <cmath>

namespace trocar::runtime {
namespace {

bool is_acute(LatticePoint corner, LatticePoint next, LatticePoint previous) noexcept {
  if (orient2d(corner, next, previous) <= 0) return false;
  const double dot = static_cast<double>(diametral_dot(next, previous, corner));
  const double lengths2 = static_cast<double>(distance2(corner, next)) *
                          static_cast<double>(distance2(corner, previous));
  return dot > 0 && dot * dot > kAcuteCorner_cos * kAcuteCorner_cos * lengths2;
}

std::uint32_t edge_towards(const SheetMesh& mesh, std::uint32_t t, std::uint32_t from) noexcept {
  return mesh.across[t][0] == from ? 0 : mesh.across[t][1] == from ? 1 : 2;
}

// Returns the start of the boundary edge that ends where e starts. It is found by turning
// around that vertex.
std::uint32_t previous_on_boundary(const SheetMesh& mesh, TriangleEdge e) noexcept {
  std::uint32_t t = e.triangle, back = previous_corner(e.edge);  // the edge that ends there
  while (mesh.across[t][back] != kNoSlot) {
    const std::uint32_t next = mesh.across[t][back];
    back = previous_corner(edge_towards(mesh, next, t));
    t = next;
  }
  return mesh.triangles[t][back];
}

// Returns the end of the boundary edge that starts where e ends.
std::uint32_t next_on_boundary(const SheetMesh& mesh, TriangleEdge e) noexcept {
  std::uint32_t t = e.triangle, on = next_corner(e.edge);
  while (mesh.across[t][on] != kNoSlot) {
    const std::uint32_t next = mesh.across[t][on];
    on = next_corner(edge_towards(mesh, next, t));
    t = next;
  }
  return mesh.triangles[t][next_corner(on)];
}

}  // namespace

SplitAim aim_split(const SheetMesh& mesh, TriangleEdge e, int parts) noexcept {
  const LatticePoint a = mesh.vertices[mesh.triangles[e.triangle][e.edge]];
  const LatticePoint b = mesh.vertices[mesh.triangles[e.triangle][next_corner(e.edge)]];
  const LatticePoint before = mesh.vertices[previous_on_boundary(mesh, e)];
  const LatticePoint after = mesh.vertices[next_on_boundary(mesh, e)];
  const bool acute_at_a = is_acute(a, b, before), acute_at_b = is_acute(b, after, a);
  if (acute_at_a == acute_at_b) {
    const int before_it = parts / 2;
    return {static_cast<double>(before_it) / parts, false, false};
  }
  const double length = std::sqrt(static_cast<double>(distance2(a, b)));
  double shell = 1;  // the power of two in (1/3, 2/3] of the length
  while (shell <= length / 3)
    shell *= 2;
  return {acute_at_a ? shell / length : 1 - shell / length, acute_at_a, acute_at_b};
}

}  // namespace trocar::runtime
