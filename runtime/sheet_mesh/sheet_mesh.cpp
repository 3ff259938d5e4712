// SPDX-License-Identifier: Apache-2.0
#include "runtime/sheet_mesh/sheet_mesh.h"

#include <algorithm>
#include <string>
#include <unordered_map>

#include "formats/geometry/mesh_validity.h"

namespace trocar::runtime {
namespace {

Error invalid(const std::string& what) {
  return {ExitCode::kBug, what};
}

// Returns the stack of the free slots `first` .. `size` - 1. The lowest slot is used first.
std::vector<std::uint32_t> free_stack(std::size_t first, std::size_t size) {
  std::vector<std::uint32_t> out;
  out.reserve(size - first);
  for (std::size_t slot = size; slot > first; --slot)
    out.push_back(static_cast<std::uint32_t>(slot - 1));
  return out;
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
  across.resize(triangles.size(), {kNone, kNone, kNone});
  reserve_stacks();
}

Result<SheetMesh> make_sheet_mesh(const SliceMesh& mesh, std::size_t spare_vertices,
                                  std::size_t spare_triangles) {
  SheetMesh out;
  out.vertices = mesh.vertices;
  out.triangles = mesh.triangles;
  out.across.assign(mesh.triangles.size(), {kNone, kNone, kNone});

  std::unordered_map<std::uint64_t, std::uint32_t> edge_of;  // directed edge -> 3 * triangle + edge
  edge_of.reserve(3 * mesh.triangles.size());
  const auto key = [](std::uint32_t from, std::uint32_t to) {
    return std::uint64_t{from} << 32 | to;
  };
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t from = mesh.triangles[t][i], to = mesh.triangles[t][(i + 1) % 3];
      if (from >= mesh.vertices.size()) {
        return refused("triangle " + std::to_string(t) + " names vertex " + std::to_string(from) +
                       " of " + std::to_string(mesh.vertices.size()));
      }
      if (const auto [at, is_new] = edge_of.emplace(key(from, to), 3 * t + i); !is_new) {
        return refused("triangles " + std::to_string(at->second / 3) + " and " + std::to_string(t) +
                       " use an edge in the same direction");
      }
      if (const auto beyond = edge_of.find(key(to, from)); beyond != edge_of.end()) {
        out.across[t][i] = beyond->second / 3;
        out.across[beyond->second / 3][beyond->second % 3] = t;
      }
    }
  }

  const std::size_t vertices = mesh.vertices.size() + spare_vertices;
  const std::size_t triangles = mesh.triangles.size() + spare_triangles;
  out.free_vertices = free_stack(mesh.vertices.size(), vertices);
  out.free_triangles = free_stack(mesh.triangles.size(), triangles);
  out.vertices.resize(vertices);
  out.triangles.resize(triangles, kFreeSlot);
  out.across.resize(triangles, {kNone, kNone, kNone});
  out.reserve_stacks();
  return out;
}

SliceMesh to_slice_mesh(const SheetMesh& mesh) {
  std::vector<std::uint32_t> number(mesh.vertices.size(), kNone);
  for (const Triangle& t : mesh.triangles) {
    if (t == kFreeSlot) continue;
    for (std::uint32_t v : t)
      number[v] = 0;
  }
  SliceMesh out;
  for (std::size_t v = 0; v < number.size(); ++v) {
    if (number[v] == kNone) continue;
    number[v] = static_cast<std::uint32_t>(out.vertices.size());
    out.vertices.push_back(mesh.vertices[v]);
  }
  for (const Triangle& t : mesh.triangles) {
    if (t != kFreeSlot) out.triangles.push_back({number[t[0]], number[t[1]], number[t[2]]});
  }
  return out;
}

Result<void> check_sheet_mesh(const SheetMesh& mesh) {
  // Invariants 1 and 3: each slot is either free or in use.
  std::vector<std::uint8_t> is_free(mesh.triangles.size(), 0), unused(mesh.vertices.size(), 1);
  for (std::uint32_t t : mesh.free_triangles) {
    if (t >= is_free.size() || is_free[t] != 0 || mesh.triangles[t] != kFreeSlot) {
      return invalid("free triangle " + std::to_string(t) + " is listed twice or in use");
    }
    is_free[t] = 1;
  }
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    if (is_free[t] != 0) continue;
    for (std::uint32_t v : mesh.triangles[t]) {
      if (v >= mesh.vertices.size()) {
        return invalid("triangle " + std::to_string(t) + " names vertex " + std::to_string(v));
      }
      unused[v] = 0;
    }
  }
  for (std::uint32_t v : mesh.free_vertices) {
    if (v >= unused.size() || unused[v] != 1) {
      return invalid("free vertex " + std::to_string(v) + " is listed twice or in use");
    }
    unused[v] = 2;
  }
  if (const auto lost = std::find(unused.begin(), unused.end(), 1); lost != unused.end()) {
    return invalid("vertex " + std::to_string(lost - unused.begin()) +
                   " is neither in use nor free");
  }

  // Invariant 2: neighbours.
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    if (is_free[t] != 0) continue;
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t u = mesh.across[t][i];
      if (u == kNone) continue;
      const std::uint32_t from = mesh.triangles[t][i], to = mesh.triangles[t][(i + 1) % 3];
      bool mutual = false;
      for (std::uint32_t j = 0; u < mesh.triangles.size() && j < 3; ++j) {
        mutual = mutual || (mesh.across[u][j] == t && mesh.triangles[u][j] == to &&
                            mesh.triangles[u][(j + 1) % 3] == from);
      }
      if (!mutual) {
        return invalid("edge " + std::to_string(i) + " of triangle " + std::to_string(t) +
                       " is not mutual");
      }
    }
  }
  const SliceMesh used = to_slice_mesh(mesh);
  if (Result<void> valid = check_mesh(used); !valid) return valid;
  // An edge without a neighbour must also be a boundary edge according to the triangles' vertices.
  std::size_t open = 0, edges_open = 0;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    if (is_free[t] == 0) {
      open +=
          static_cast<std::size_t>(std::count(mesh.across[t].begin(), mesh.across[t].end(), kNone));
    }
  }
  for (const Ring& ring : boundary_rings(used).rings)
    edges_open += ring.size();
  if (open != edges_open) return invalid("an edge between two triangles has no neighbour");
  return {};
}

}  // namespace trocar::runtime
