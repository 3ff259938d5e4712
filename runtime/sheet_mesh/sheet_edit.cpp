// SPDX-License-Identifier: Apache-2.0
#include "runtime/sheet_mesh/sheet_edit.h"

namespace trocar::runtime {

namespace {

void undo_pops(std::size_t untouched, const std::vector<std::uint32_t>& popped,
               std::vector<std::uint32_t>& stack) noexcept {
  stack.resize(untouched);
  stack.insert(stack.end(), popped.rbegin(), popped.rend());
}

void copy_stack(std::size_t untouched, const std::vector<std::uint32_t>& from,
                std::vector<std::uint32_t>& to) noexcept {
  to.resize(untouched);
  to.insert(to.end(), from.begin() + static_cast<std::ptrdiff_t>(untouched), from.end());
}

}  // namespace

std::uint32_t SheetEdit::pop(std::vector<std::uint32_t>& stack, std::size_t& untouched,
                             std::vector<std::uint32_t>& popped) noexcept {
  if (stack.empty()) return kNoSlot;
  const std::uint32_t slot = stack.back();
  if (stack.size() == untouched) {
    popped.push_back(slot);
    --untouched;
  }
  stack.pop_back();
  return slot;
}

SheetEdit::SheetEdit(std::size_t vertex_slots, std::size_t triangle_slots) {
  reserve_touched(change_.triangles, triangle_slots);
  reserve_touched(change_.vertices, vertex_slots);
  reserve_touched(popped_triangles_, triangle_slots);
  reserve_touched(popped_vertices_, vertex_slots);
  triangle_listed_.allocate(triangle_slots);
  vertex_listed_.allocate(vertex_slots);
}

void SheetEdit::begin(const SheetMesh& mesh) noexcept {
  change_.triangles.clear();
  change_.vertices.clear();
  change_.untouched_free_triangles = mesh.free_triangles.size();
  change_.untouched_free_vertices = mesh.free_vertices.size();
  popped_triangles_.clear();
  popped_vertices_.clear();
  triangle_listed_.clear();
  vertex_listed_.clear();
}

void SheetEdit::touch_triangle(const SheetMesh& mesh, std::uint32_t t) noexcept {
  const std::size_t listed = triangle_listed_.size();
  triangle_listed_.insert(t, 0);
  if (triangle_listed_.size() == listed) return;
  change_.triangles.push_back({t, mesh.triangles[t], mesh.across[t]});
}

void SheetEdit::touch_vertex(const SheetMesh& mesh, std::uint32_t v) noexcept {
  const std::size_t listed = vertex_listed_.size();
  vertex_listed_.insert(v, 0);
  if (vertex_listed_.size() == listed) return;
  change_.vertices.push_back({v, mesh.vertices[v]});
}

std::uint32_t SheetEdit::take_triangle(SheetMesh& mesh, const Triangle& corners) noexcept {
  const std::uint32_t t =
      pop(mesh.free_triangles, change_.untouched_free_triangles, popped_triangles_);
  if (t == kNoSlot) return kNoSlot;
  touch_triangle(mesh, t);
  mesh.triangles[t] = corners;
  mesh.across[t] = {kNoSlot, kNoSlot, kNoSlot};
  return t;
}

std::uint32_t SheetEdit::take_vertex(SheetMesh& mesh, LatticePoint point) noexcept {
  const std::uint32_t v =
      pop(mesh.free_vertices, change_.untouched_free_vertices, popped_vertices_);
  if (v == kNoSlot) return kNoSlot;
  touch_vertex(mesh, v);
  mesh.vertices[v] = point;
  return v;
}

void SheetEdit::release_triangle(SheetMesh& mesh, std::uint32_t t) noexcept {
  touch_triangle(mesh, t);
  mesh.triangles[t] = kFreeSlot;
  mesh.across[t] = {kNoSlot, kNoSlot, kNoSlot};
  mesh.free_triangles.push_back(t);
}

void SheetEdit::release_vertex(SheetMesh& mesh, std::uint32_t v) noexcept {
  mesh.free_vertices.push_back(v);
}

void SheetEdit::undo(SheetMesh& mesh) noexcept {
  for (const OldTriangle& old : change_.triangles) {
    mesh.triangles[old.slot] = old.corners;
    mesh.across[old.slot] = old.across;
  }
  for (const OldVertex& old : change_.vertices)
    mesh.vertices[old.slot] = old.point;
  undo_pops(change_.untouched_free_triangles, popped_triangles_, mesh.free_triangles);
  undo_pops(change_.untouched_free_vertices, popped_vertices_, mesh.free_vertices);
  begin(mesh);
}

void SheetChange::copy_to(const SheetMesh& from, SheetMesh& to) const noexcept {
  for (const OldTriangle& old : triangles) {
    to.triangles[old.slot] = from.triangles[old.slot];
    to.across[old.slot] = from.across[old.slot];
  }
  for (const OldVertex& old : vertices)
    to.vertices[old.slot] = from.vertices[old.slot];
  copy_stack(untouched_free_triangles, from.free_triangles, to.free_triangles);
  copy_stack(untouched_free_vertices, from.free_vertices, to.free_vertices);
}

}  // namespace trocar::runtime
