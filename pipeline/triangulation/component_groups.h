// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "formats/geometry/slice_mesh.h"

namespace trocar::pipeline {

/// Divides a mesh into groups of whole connected components (triangles that share a vertex are
/// connected). Use it for work on components that do not depend on each other. The data of a group
/// fit into a processor's cache, and the memory of a group is reused for the next one.
class ComponentGroups {
 public:
  /// A group has at most this many vertices unless it is a single component.
  static constexpr std::uint32_t kMaxVertices = 1 << 15;

  struct Group {
    std::span<const std::uint32_t> vertices, triangles;  ///< indices in the whole mesh, ascending
    SliceMesh mesh;  ///< these vertices and triangles, in the same order
    /// One entry for each vertex of `mesh`: the smallest vertex of its component. Vertices are
    /// indices in `mesh`.
    std::vector<std::uint32_t> component;
  };

  /// Every vertex and triangle of `mesh` is in one group. Precondition: `mesh` has at least one
  /// vertex and outlives this object. O(n).
  explicit ComponentGroups(const SliceMesh& mesh);

  std::size_t count() const { return vertices_.first.size() - 1; }
  /// Returns group g. The result is valid until the next call. O(size of the group).
  const Group& group(std::size_t g);

 private:
  struct List {  // the items of all groups; those of group g begin at first[g]
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
