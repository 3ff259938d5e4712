// SPDX-License-Identifier: Apache-2.0
#include "runtime/local_refinement/point_insertion.h"

#include <algorithm>

namespace trocar::runtime {
namespace {

bool circumcircle_contains(const SheetMesh& mesh, std::uint32_t t, LatticePoint p) noexcept {
  const auto [a, b, c] = corners(mesh, t);
  return in_circle(a, b, c, p) > 0;
}

}  // namespace

PointInsertion::PointInsertion(std::size_t vertex_slots, std::size_t triangle_slots)
    : visited_(triangle_slots, 0), starting_(vertex_slots, kNoSlot) {
  cavity_.reserve(kMaxCavity);
  boundary_.reserve(kMaxCavity + 2);
  star_.reserve(kMaxCavity + 2);
}

bool PointInsertion::find(const SheetMesh& mesh, std::uint32_t start, LatticePoint p) noexcept {
  cavity_.clear();
  boundary_.clear();
  if (!circumcircle_contains(mesh, start, p)) return false;
  if (++search_ == 0) {  // the counter has wrapped around: old marks could equal new ones
    std::fill(visited_.begin(), visited_.end(), 0);
    search_ = 1;
  }
  visited_[start] = search_;
  cavity_.push_back(start);
  for (std::size_t k = 0; k < cavity_.size(); ++k) {
    const std::uint32_t t = cavity_[k];
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t beyond = mesh.across[t][i];
      if (beyond != kNoSlot && visited_[beyond] == search_) continue;
      if (beyond != kNoSlot && circumcircle_contains(mesh, beyond, p)) {
        if (cavity_.size() == kMaxCavity) return false;
        visited_[beyond] = search_;
        cavity_.push_back(beyond);
        continue;
      }
      if (boundary_.size() == kMaxCavity + 2) return false;
      boundary_.push_back(
          {mesh.triangles[t][i], mesh.triangles[t][next_corner(i)], beyond, {t, i}});
    }
  }
  return true;
}

InsertionOutcome PointInsertion::insert(SheetMesh& mesh, SheetEdit& edit, LatticePoint p,
                                        std::uint32_t split) noexcept {
  // If the cavity's boundary is one loop, it has two edges more than the cavity has triangles.
  if (boundary_.size() != cavity_.size() + 2) return InsertionOutcome::kNotVisible;
  for (std::uint32_t k = 0; k < boundary_.size(); ++k) {
    if (k == split) continue;
    if (orient2d(mesh.vertices[boundary_[k].from], mesh.vertices[boundary_[k].to], p) <= 0)
      return InsertionOutcome::kNotVisible;
  }
  const std::size_t star_size = boundary_.size() - (split == kNoSlot ? 0 : 1);
  if (mesh.free_vertices.empty() || mesh.free_triangles.size() + cavity_.size() < star_size)
    return InsertionOutcome::kCapacity;

  vertex_ = edit.take_vertex(mesh, p);
  star_.clear();
  for (const std::uint32_t t : cavity_) {
    edit.touch_triangle(mesh, t);
    star_.push_back(t);
  }
  while (star_.size() < star_size)
    star_.push_back(edit.take_triangle(mesh, {vertex_, vertex_, vertex_}));
  // Link the neighbours outside first, because the triangles in the cavity are overwritten below.
  if (split != kNoSlot) {
    starting_[boundary_[split].from] = kNoSlot;  // no other edge starts there
    boundary_.erase(boundary_.begin() + split);
  }
  for (std::size_t k = 0; k < star_size; ++k) {
    const CavityEdge& r = boundary_[k];
    starting_[r.from] = star_[k];
    if (r.beyond == kNoSlot) continue;
    edit.touch_triangle(mesh, r.beyond);
    mesh.across[r.beyond][corner_of(mesh.triangles[r.beyond], r.to)] = star_[k];
  }
  for (std::size_t k = 0; k < star_size; ++k) {
    mesh.triangles[star_[k]] = {boundary_[k].from, boundary_[k].to, vertex_};
    mesh.across[star_[k]] = {boundary_[k].beyond, kNoSlot, kNoSlot};
  }
  for (std::size_t k = 0; k < star_size; ++k) {
    const std::uint32_t next = starting_[boundary_[k].to];
    if (next == kNoSlot) continue;  // the edge that was split
    mesh.across[star_[k]][1] = next;
    mesh.across[next][2] = star_[k];
  }
  return InsertionOutcome::kDone;
}

}  // namespace trocar::runtime
