// SPDX-License-Identifier: Apache-2.0
// The directed edges of a mesh, sorted so that the two directions of an edge are next to each
// other. Every walk over neighbours starts from this table.
// Tests: tests/formats/geometry/mesh_validity_test.cpp
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "formats/geometry/slice_mesh.h"

namespace trocar {

/// All three edges of every triangle. Edge 3 t + i of the mesh is edge i of triangle t
/// (triangle_edge.h).
struct EdgeTable {
  struct Entry {
    std::uint32_t high;  ///< the higher of its two vertices
    std::uint32_t edge;
  };
  std::vector<Entry> entries;        ///< sorted by the lower vertex, then `high`, then `edge`
  std::vector<std::uint32_t> first;  ///< index of each vertex's first entry as lower vertex; then
                                     ///< the end

  /// Calls visit(low, high, edges) for every pair of vertices with an edge, ascending by low and
  /// high. `edges` has the entries of both directions: in a valid mesh two for an interior edge,
  /// one for a boundary edge. Stops when visit() returns false.
  template <typename Visit>
  void for_each_pair(const Visit& visit) const {
    for (std::uint32_t low = 0; low + 1 < first.size(); ++low) {
      for (std::size_t i = first[low], j = i; i < first[low + 1]; i = j) {
        while (j < first[low + 1] && entries[j].high == entries[i].high)
          ++j;
        if (!visit(low, entries[i].high, std::span(entries).subspan(i, j - i))) return;
      }
    }
  }
};

/// Makes the table. Every index must be in range, and every triangle must have three different
/// vertices. O(n).
EdgeTable edge_table(const SliceMesh& mesh);

}  // namespace trocar
