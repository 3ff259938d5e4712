// SPDX-License-Identifier: Apache-2.0
#include "runtime/sheet_mesh/sheet_edit.h"

namespace trocar::runtime {

void SheetEdit::Stack::begin(const std::vector<std::uint32_t>& stack) noexcept {
  untouched = stack.size();
  popped.clear();
}

std::uint32_t SheetEdit::Stack::pop(std::vector<std::uint32_t>& stack) noexcept {
  if (stack.empty()) return kNone;
  const std::uint32_t slot = stack.back();
  if (stack.size() == untouched) {
    popped.push_back(slot);
    --untouched;
  }
  stack.pop_back();
  return slot;
}

void SheetEdit::Stack::undo(std::vector<std::uint32_t>& stack) const noexcept {
  stack.resize(untouched);
  stack.insert(stack.end(), popped.rbegin(), popped.rend());
}

void SheetEdit::Stack::copy(const std::vector<std::uint32_t>& from,
                            std::vector<std::uint32_t>& to) const noexcept {
  to.resize(untouched);
  to.insert(to.end(), from.begin() + static_cast<std::ptrdiff_t>(untouched), from.end());
}

SheetEdit::SheetEdit(const SheetMesh& mesh) {
  reserve_touched(triangles_, mesh.triangles.size());
  reserve_touched(vertices_, mesh.vertices.size());
  reserve_touched(free_triangles_.popped, mesh.triangles.size());
  reserve_touched(free_vertices_.popped, mesh.vertices.size());
  triangle_listed_.allocate(mesh.triangles.size());
  vertex_listed_.allocate(mesh.vertices.size());
}

void SheetEdit::begin(const SheetMesh& mesh) noexcept {
  triangles_.clear();
  vertices_.clear();
  free_triangles_.begin(mesh.free_triangles);
  free_vertices_.begin(mesh.free_vertices);
  triangle_listed_.clear();
  vertex_listed_.clear();
}

void SheetEdit::touch_triangle(const SheetMesh& mesh, std::uint32_t t) noexcept {
  const std::size_t listed = triangle_listed_.size();
  triangle_listed_.insert(t, 0);
  if (triangle_listed_.size() == listed) return;
  triangles_.push_back({t, mesh.triangles[t], mesh.across[t]});
}

void SheetEdit::touch_vertex(const SheetMesh& mesh, std::uint32_t v) noexcept {
  const std::size_t listed = vertex_listed_.size();
  vertex_listed_.insert(v, 0);
  if (vertex_listed_.size() == listed) return;
  vertices_.push_back({v, mesh.vertices[v]});
}

std::uint32_t SheetEdit::take_triangle(SheetMesh& mesh, const Triangle& corners) noexcept {
  const std::uint32_t t = free_triangles_.pop(mesh.free_triangles);
  if (t == kNone) return kNone;
  touch_triangle(mesh, t);
  mesh.triangles[t] = corners;
  mesh.across[t] = {kNone, kNone, kNone};
  return t;
}

std::uint32_t SheetEdit::take_vertex(SheetMesh& mesh, LatticePoint point) noexcept {
  const std::uint32_t v = free_vertices_.pop(mesh.free_vertices);
  if (v == kNone) return kNone;
  touch_vertex(mesh, v);
  mesh.vertices[v] = point;
  return v;
}

void SheetEdit::release_triangle(SheetMesh& mesh, std::uint32_t t) noexcept {
  touch_triangle(mesh, t);
  mesh.triangles[t] = kFreeSlot;
  mesh.across[t] = {kNone, kNone, kNone};
  mesh.free_triangles.push_back(t);
}

void SheetEdit::release_vertex(SheetMesh& mesh, std::uint32_t v) noexcept {
  mesh.free_vertices.push_back(v);
}

void SheetEdit::undo(SheetMesh& mesh) noexcept {
  for (const OldTriangle& old : triangles_) {
    mesh.triangles[old.slot] = old.corners;
    mesh.across[old.slot] = old.across;
  }
  for (const OldVertex& old : vertices_)
    mesh.vertices[old.slot] = old.point;
  free_triangles_.undo(mesh.free_triangles);
  free_vertices_.undo(mesh.free_vertices);
  begin(mesh);
}

void SheetEdit::copy_to(const SheetMesh& from, SheetMesh& to) const noexcept {
  for (const OldTriangle& old : triangles_) {
    to.triangles[old.slot] = from.triangles[old.slot];
    to.across[old.slot] = from.across[old.slot];
  }
  for (const OldVertex& old : vertices_)
    to.vertices[old.slot] = from.vertices[old.slot];
  free_triangles_.copy(from.free_triangles, to.free_triangles);
  free_vertices_.copy(from.free_vertices, to.free_vertices);
}

}  // namespace trocar::runtime
