// SPDX-License-Identifier: GPL-3.0-or-later
// Divides a mesh into groups of connected components that are small enough for a processor's cache.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "formats/geometry/slice_mesh.h"

namespace trocar::pipeline {

/// Divides a mesh into groups of whole connected components (triangles that share a vertex are
/// connected). Use it for a computation that can treat each component without the others: the
/// computation is faster if it treats one group after another. The data of a group fit into a
/// processor's cache, unless the group is a single large component. All groups use the same memory.
class ComponentGroups {
 public:
  /// A group has at most this many vertices unless it is a single component.
  static constexpr std::uint32_t kMaxVertices = 1 << 15;

  struct Group {
    std::span<const std::uint32_t> vertices, triangles;  ///< indices in the whole mesh, ascending
    SliceMesh mesh;  ///< these vertices and triangles, in the same order
    /// One entry for each vertex of `mesh`: the vertex with the lowest index in its component. This
    /// vertex identifies the component. Both vertices are indices in `mesh`.
    std::vector<std::uint32_t> component;
  };

  /// Every vertex and triangle of `mesh` is in one group. Precondition: `mesh` has at least one
  /// vertex and outlives this object. O(n).
  explicit ComponentGroups(const SliceMesh& mesh);

  std::size_t count() const { return vertices_.first.size() - 1; }
  /// Returns group g. The result is valid until the next call. O(size of the group).
  const Group& group(std::size_t g);

 private:
  struct List {  // vertices or triangles of all groups; those of group g begin at items[first[g]]
    std::vector<std::uint32_t> items, first;
    std::span<const std::uint32_t> of(std::size_t g) const {
      return std::span(items).subspan(first[g], first[g + 1] - first[g]);
    }
  };
  template <typename GroupOf>
  static List listed(std::size_t count, std::size_t groups, const GroupOf& group_of);

  const SliceMesh& mesh_;
  std::vector<std::uint32_t> component_;  // for each vertex: the smallest vertex of its component
  List vertices_, triangles_;
  std::vector<std::uint32_t> number_;  // for each vertex: its number in its group
  Group group_;
};

}  // namespace trocar::pipeline
