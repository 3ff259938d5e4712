// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/sheet_mesh.h"

#include <numeric>

namespace trocar {
namespace {

// Returns the stack of the free slots `first` .. `size` - 1. The lowest slot is used first.
std::vector<std::uint32_t> free_stack(std::size_t first, std::size_t size) {
  std::vector<std::uint32_t> out;
  out.reserve(size - first);
  for (std::size_t slot = size; slot > first; --slot)
    out.push_back(static_cast<std::uint32_t>(slot - 1));
  return out;
}

// A directed edge of a triangle, listed at the vertex where it begins.
struct EdgeTo {
  std::uint32_t to;
  std::uint32_t triangle;
  std::uint32_t edge;
};

// The triangle beyond each edge of each triangle. Errors: those of make_sheet_mesh().
Result<std::vector<std::array<std::uint32_t, 3>>> checked_neighbours(const SliceMesh& mesh) {
  // The edges that begin at a vertex v are edges[first[v]] to edges[first[v + 1] - 1].
  std::vector<std::uint32_t> first(mesh.vertices.size() + 1, 0);
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    for (const std::uint32_t from : mesh.triangles[t]) {
      if (from >= mesh.vertices.size())
        return refused("triangle " + std::to_string(t) + " names vertex " + std::to_string(from) +
                       " of " + std::to_string(mesh.vertices.size()));
      ++first[from + 1];
    }
  }
  std::partial_sum(first.begin(), first.end(), first.begin());
  std::vector<EdgeTo> edges(3 * mesh.triangles.size());
  std::vector<std::uint32_t> next(first.begin(), first.end() - 1);
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const Triangle& v = mesh.triangles[t];
    for (std::uint32_t i = 0; i < 3; ++i)
      edges[next[v[i]]++] = {v[(i + 1) % 3], t, i};
  }
  const auto by_end = [](const EdgeTo& a, const EdgeTo& b) { return a.to < b.to; };
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const auto from = edges.begin() + first[v], to = edges.begin() + first[v + 1];
    std::sort(from, to, [](const EdgeTo& a, const EdgeTo& b) {
      return a.to != b.to ? a.to < b.to : a.triangle < b.triangle;
    });
    const auto twice =
        std::adjacent_find(from, to, [](const EdgeTo& a, const EdgeTo& b) { return a.to == b.to; });
    if (twice != to)
      return refused("triangles " + std::to_string(twice->triangle) + " and " +
                     std::to_string(std::next(twice)->triangle) +
                     " use an edge in the same direction");
  }
  std::vector<std::array<std::uint32_t, 3>> across(mesh.triangles.size(),
                                                   {kNoSlot, kNoSlot, kNoSlot});
  for (std::uint32_t v = 0; v < mesh.vertices.size(); ++v) {
    for (std::size_t k = first[v]; k < first[v + 1]; ++k) {
      const auto end = edges.begin() + first[edges[k].to + 1];
      const auto back =
          std::lower_bound(edges.begin() + first[edges[k].to], end, EdgeTo{v, 0, 0}, by_end);
      if (back != end && back->to == v) across[edges[k].triangle][edges[k].edge] = back->triangle;
    }
  }
  return across;
}

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

void SheetMesh::add_slots(std::size_t more_vertices, std::size_t more_triangles) {
  const auto lay_under = [](std::vector<std::uint32_t>& stack,
                            const std::vector<std::uint32_t>& slots) {
    stack.insert(stack.begin(), slots.begin(), slots.end());
  };
  lay_under(free_vertices, free_stack(vertices.size(), vertices.size() + more_vertices));
  lay_under(free_triangles, free_stack(triangles.size(), triangles.size() + more_triangles));
  vertices.resize(vertices.size() + more_vertices);
  triangles.resize(triangles.size() + more_triangles, kFreeSlot);
  across.resize(triangles.size(), {kNoSlot, kNoSlot, kNoSlot});
  reserve_stacks();
}

void SheetMesh::remove_spare_slots() {
  vertices.resize(vertices_in_use());
  triangles.resize(triangles_in_use());
  across.resize(triangles.size());
  free_vertices = {};
  free_triangles = {};
}

Result<SheetMesh> make_sheet_mesh(const SliceMesh& mesh, std::size_t spare_vertices,
                                  std::size_t spare_triangles) {
  SheetMesh out;
  out.vertices = mesh.vertices;
  out.triangles = mesh.triangles;
  if (const auto ok = checked_neighbours(mesh).into(out.across); !ok) return ok.error();
  out.add_slots(spare_vertices, spare_triangles);
  return out;
}

SliceMesh to_slice_mesh(const SheetMesh& mesh) {
  std::vector<std::uint32_t> number(mesh.vertices.size(), kNoSlot);
  for (const Triangle& t : mesh.triangles) {
    if (t == kFreeSlot) continue;
    for (std::uint32_t v : t)
      number[v] = 0;
  }
  SliceMesh out;
  for (std::size_t v = 0; v < number.size(); ++v) {
    if (number[v] == kNoSlot) continue;
    number[v] = static_cast<std::uint32_t>(out.vertices.size());
    out.vertices.push_back(mesh.vertices[v]);
  }
  for (const Triangle& t : mesh.triangles) {
    if (t != kFreeSlot) out.triangles.push_back({number[t[0]], number[t[1]], number[t[2]]});
  }
  return out;
}

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

}  // namespace trocar
