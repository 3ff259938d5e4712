// SPDX-License-Identifier: Apache-2.0
// The directed edges of a mesh, sorted so that the two directions of an edge are next to each
// other. Mesh operations use this table to find the neighbours of triangles.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "formats/mesh/slice_mesh.h"

namespace trocar {

/// All three edges of every triangle. The number 3 t + i stands for edge i of triangle t. The edges
/// of a triangle are numbered 0 to 2, as in predicates.h.
struct EdgeTable {
  struct Entry {
    std::uint32_t high;  ///< the higher of the edge's two vertices
    std::uint32_t edge;  ///< 3 t + i
  };
  std::vector<Entry> entries;  ///< sorted by the lower vertex, then `high`, then `edge`
  /// first[v] is the index of the first entry whose lower vertex is v or higher. The last element,
  /// first[number of vertices], is the number of entries.
  std::vector<std::uint32_t> first;

  /// Calls visit(low, high, edges) for every pair of vertices that an edge joins, in ascending
  /// order of (low, high). `edges` has the entries of both directions: in a valid mesh, two entries
  /// for an interior edge and one for a boundary edge. Stops when visit() returns false.
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

/// Makes the table. Precondition: every vertex index is in range, and every triangle has three
/// different vertices. O(n).
EdgeTable edge_table(const SliceMesh& mesh);

}  // namespace trocar
