// SPDX-License-Identifier: Apache-2.0
// Verifies the invariants of a sheet mesh, independently of the code that edits sheets.
#pragma once

#include <algorithm>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/sheet_mesh.h"

namespace trocar::runtime {

/// Verifies invariants 1 to 3 of SheetMesh. O(n log n). If an invariant does not hold, the function
/// returns an error whose message describes the first violation that was found.
inline Result<void> check_sheet_mesh(const SheetMesh& mesh) {
  // Invariants 1 and 3: each slot is either free or in use.
  std::vector<std::uint8_t> is_free(mesh.triangles.size(), 0), unused(mesh.vertices.size(), 1);
  for (std::uint32_t t : mesh.free_triangles) {
    if (t >= is_free.size() || is_free[t] != 0 || mesh.triangles[t] != kFreeSlot) {
      return bug("free triangle " + std::to_string(t) + " is listed twice or in use");
    }
    is_free[t] = 1;
  }
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    if (is_free[t] != 0) continue;
    for (std::uint32_t v : mesh.triangles[t]) {
      if (v >= mesh.vertices.size()) {
        return bug("triangle " + std::to_string(t) + " names vertex " + std::to_string(v));
      }
      unused[v] = 0;
    }
  }
  for (std::uint32_t v : mesh.free_vertices) {
    if (v >= unused.size() || unused[v] != 1) {
      return bug("free vertex " + std::to_string(v) + " is listed twice or in use");
    }
    unused[v] = 2;
  }
  if (const auto lost = std::find(unused.begin(), unused.end(), 1); lost != unused.end()) {
    return bug("vertex " + std::to_string(lost - unused.begin()) + " is neither in use nor free");
  }

  // Invariant 2: neighbours.
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    if (is_free[t] != 0) continue;
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t u = mesh.across[t][i];
      if (u == kNoSlot) continue;
      const std::uint32_t from = mesh.triangles[t][i], to = mesh.triangles[t][(i + 1) % 3];
      bool mutual = false;
      for (std::uint32_t j = 0; u < mesh.triangles.size() && j < 3; ++j) {
        mutual = mutual || (mesh.across[u][j] == t && mesh.triangles[u][j] == to &&
                            mesh.triangles[u][(j + 1) % 3] == from);
      }
      if (!mutual) {
        return bug("edge " + std::to_string(i) + " of triangle " + std::to_string(t) +
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
      open += static_cast<std::size_t>(
          std::count(mesh.across[t].begin(), mesh.across[t].end(), kNoSlot));
    }
  }
  for (const Ring& ring : boundary_rings(used).rings)
    edges_open += ring.size();
  if (open != edges_open) return bug("an edge between two triangles has no neighbour");
  return {};
}

}  // namespace trocar::runtime
