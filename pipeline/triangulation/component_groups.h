// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "formats/geometry/slice_mesh.h"

namespace trocar::pipeline {

/// Divides a mesh into groups of whole connected components (triangles that share a vertex are
/// connected). It is meant for work in which components do not depend on each other. A group's data
/// fit into a processor's cache, and its memory is reused for the next group.
class ComponentGroups {
 public:
  /// A group has at most this many vertices unless it is a single component.
  static constexpr std::uint32_t kMaxVertices = 1 << 15;

  struct Group {
    std::span<const std::uint32_t> vertices, triangles;  ///< numbers in the whole mesh, ascending
    SliceMesh mesh;                                      ///< only these, in this order
    std::vector<std::uint32_t>
        component;  ///< least vertex of the component of each vertex of `mesh`
  };

  /// Every vertex and triangle of `mesh` is in one group. `mesh` has at least one vertex and must
  /// outlive this object. O(n).
  explicit ComponentGroups(const SliceMesh& mesh);

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
  std::vector<std::uint32_t> component_;  // by vertex: the least vertex of its component
  List vertices_, triangles_;
  std::vector<std::uint32_t> number_;  // by vertex: its number in its group
  Group group_;
};

}  // namespace trocar::pipeline
