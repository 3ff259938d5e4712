// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "formats/geometry/slice_mesh.h"

namespace trocar::pipeline {

/// A mesh in groups of whole connected parts (triangles that share a vertex are connected), for
/// work in which parts do not depend on each other: a group's data stay within a processor's cache,
/// and its memory serves the next group.
class PartGroups {
 public:
  /// A group has at most this many vertices, or is one part.
  static constexpr std::uint32_t kVertices = 1 << 15;

  struct Group {
    std::span<const std::uint32_t> vertices, triangles;  ///< of the whole mesh, ascending
    SliceMesh mesh;                                      ///< these alone, in this order
    std::vector<std::uint32_t> part;  ///< by vertex of `mesh`: the least vertex of its part
  };

  /// Every vertex and triangle of `mesh` is in one group. `mesh` has at least one vertex, and is
  /// used as long as this is. O(n).
  explicit PartGroups(const SliceMesh& mesh);

  std::size_t count() const { return vertices_.first.size() - 1; }
  /// Valid until the next call. O(size of the group).
  const Group& group(std::size_t g);

 private:
  struct List {  // by group
    std::vector<std::uint32_t> items, first;
    std::span<const std::uint32_t> of(std::size_t g) const {
      return std::span(items).subspan(first[g], first[g + 1] - first[g]);
    }
  };
  template <typename GroupOf>
  static List listed(std::size_t count, std::size_t groups, const GroupOf& group_of);

  const SliceMesh& mesh_;
  std::vector<std::uint32_t> part_;  // by vertex: the least of its part
  List vertices_, triangles_;
  std::vector<std::uint32_t> number_;  // by vertex: its number in its group
  Group group_;
};

}  // namespace trocar::pipeline
