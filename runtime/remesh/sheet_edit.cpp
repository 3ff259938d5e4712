// SPDX-License-Identifier: Apache-2.0
#include "runtime/remesh/sheet_edit.h"

#include <algorithm>

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

SheetEdit::SheetEdit(const SheetMesh& mesh)
    : triangle_listed_(mesh.triangles.size(), 0), vertex_listed_(mesh.vertices.size(), 0) {
  triangles_.reserve(mesh.triangles.size());
  vertices_.reserve(mesh.vertices.size());
  free_triangles_.popped.reserve(mesh.triangles.size());
  free_vertices_.popped.reserve(mesh.vertices.size());
}

void SheetEdit::begin(const SheetMesh& mesh) noexcept {
  triangles_.clear();
  vertices_.clear();
  free_triangles_.begin(mesh.free_triangles);
  free_vertices_.begin(mesh.free_vertices);
  if (++edit_ == 0) {  // the count has come round: old marks could be taken for new ones
    std::fill(triangle_listed_.begin(), triangle_listed_.end(), 0);
    std::fill(vertex_listed_.begin(), vertex_listed_.end(), 0);
    edit_ = 1;
  }
}

void SheetEdit::touch_triangle(const SheetMesh& mesh, std::uint32_t t) noexcept {
  if (triangle_listed_[t] == edit_) return;
  triangle_listed_[t] = edit_;
  OldTriangle old{t, mesh.triangles[t], mesh.across[t], {}};
  if (mesh.in_use(t)) old.box = box_around(corners(mesh, t));
  triangles_.push_back(old);
}

void SheetEdit::touch_vertex(const SheetMesh& mesh, std::uint32_t v) noexcept {
  if (vertex_listed_[v] == edit_) return;
  vertex_listed_[v] = edit_;
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
