// SPDX-License-Identifier: Apache-2.0
// The directed edges of a mesh, sorted so that the two directions of an edge are next to each
// other: the start of every walk over neighbours.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "formats/geometry/slice_mesh.h"

namespace trocar {

struct DirectedEdge {
  std::uint32_t from, to, triangle;
  std::pair<std::uint32_t, std::uint32_t> key() const {
    return from < to ? std::pair{from, to} : std::pair{to, from};
  }
};

/// All three edges of every triangle, ordered by key(), then by `from`. In a valid mesh an inner
/// edge comes as two entries with one key, a boundary edge as one. Every index of `mesh` is in
/// range. O(n) for bounded vertex degrees (a counting sort by the lower vertex).
std::vector<DirectedEdge> sorted_edges(const SliceMesh& mesh);

}  // namespace trocar
