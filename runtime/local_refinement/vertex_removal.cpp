// SPDX-License-Identifier: Apache-2.0
#include "runtime/local_refinement/vertex_removal.h"

#include <algorithm>

namespace trocar::runtime {

bool VertexRemoval::plan(const SheetMesh& mesh, std::uint32_t t, std::uint32_t corner) noexcept {
  // Turn counter-clockwise around the vertex; each triangle contributes the edge opposite to it.
  vertex_ = mesh.triangles[t][corner];
  degree_ = 0;
  std::uint32_t at = t;
  do {
    if (degree_ == kMaxDegree) return false;
    const std::uint32_t i = corner_of(mesh.triangles[at], vertex_);
    star_[degree_] = at;
    polygon_[degree_] = mesh.triangles[at][next_corner(i)];
    beyond_[degree_] = {false, mesh.across[at][next_corner(i)]};
    ++degree_;
    at = mesh.across[at][previous_corner(i)];
    if (at == kNoSlot) return false;
  } while (at != t);
  if (degree_ < 3) return false;

  std::size_t size = degree_;
  for (std::uint32_t number = 0; size > 3; ++number) {
    std::size_t k = 0;
    while (k < size && !is_ear(mesh, (k + size - 1) % size, k, (k + 1) % size, size))
      ++k;
    if (k == size) return false;
    const std::size_t previous = (k + size - 1) % size;
    ears_[number] = {{polygon_[previous], polygon_[k], polygon_[(k + 1) % size]},
                     {beyond_[previous], beyond_[k]}};
    beyond_[previous] = {true, number};
    std::copy(polygon_.begin() + k + 1, polygon_.begin() + size, polygon_.begin() + k);
    std::copy(beyond_.begin() + k + 1, beyond_.begin() + size, beyond_.begin() + k);
    --size;
  }
  if (!is_ear(mesh, 0, 1, 2, 3)) return false;
  ears_[degree_ - 3] = {{polygon_[0], polygon_[1], polygon_[2]}, {beyond_[0], beyond_[1]}};
  last_ = beyond_[2];
  return true;
}

bool VertexRemoval::is_ear(const SheetMesh& mesh, std::size_t previous, std::size_t at,
                           std::size_t next, std::size_t size) const noexcept {
  const LatticePoint a = mesh.vertices[polygon_[previous]], b = mesh.vertices[polygon_[at]],
                     c = mesh.vertices[polygon_[next]];
  if (orient2d(a, b, c) <= 0) return false;
  for (std::size_t k = 0; k < size; ++k) {
    if (k != previous && k != at && k != next && in_circle(a, b, c, mesh.vertices[polygon_[k]]) > 0)
      return false;
  }
  return true;
}

void VertexRemoval::remove(SheetMesh& mesh, SheetEdit& edit) noexcept {
  const std::size_t ears = degree_ - 2;
  for (std::size_t k = 0; k < ears; ++k)
    edit.touch_triangle(mesh, star_[k]);
  const auto link = [&](std::uint32_t ear, std::uint32_t edge, Beyond beyond) {
    const std::uint32_t own = star_[ear];
    if (beyond.is_ear) {
      mesh.across[own][edge] = star_[beyond.number];
      mesh.across[star_[beyond.number]][2] = own;
      return;
    }
    mesh.across[own][edge] = beyond.number;
    if (beyond.number == kNoSlot) return;
    edit.touch_triangle(mesh, beyond.number);
    const std::uint32_t to = ears_[ear].corners[next_corner(edge)];
    mesh.across[beyond.number][corner_of(mesh.triangles[beyond.number], to)] = own;
  };
  for (std::uint32_t ear = 0; ear < ears; ++ear)
    mesh.triangles[star_[ear]] = ears_[ear].corners;
  for (std::uint32_t ear = 0; ear < ears; ++ear) {
    link(ear, 0, ears_[ear].across[0]);
    link(ear, 1, ears_[ear].across[1]);
  }
  link(static_cast<std::uint32_t>(ears - 1), 2, last_);
  for (const std::uint32_t t : freed())
    edit.release_triangle(mesh, t);
  edit.release_vertex(mesh, vertex_);
}

}  // namespace trocar::runtime
