// SPDX-License-Identifier: Apache-2.0
// Inserts a point into a SheetMesh. If the mesh is constrained Delaunay, it stays so. A sheet is
// constrained Delaunay if, for each edge between two triangles, the two angles opposite the edge
// add up to at most 180 degrees. Only the edges of the sheet's boundary are constraints: a border
// between two materials inside the sheet is not one. The triangles whose circumcircles contain the
// point form the cavity. They are replaced by the star of the point, which consists of the
// triangles between the point and the edges of the cavity's boundary (Bowyer; Watson, 1981). All
// geometric tests are exact.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "runtime/sheet_mesh/sheet_edit.h"
#include "runtime/sheet_mesh/sheet_mesh.h"

namespace trocar::runtime {

/// An edge of the cavity's boundary, with the cavity on its left.
struct CavityEdge {
  std::uint32_t from, to;  ///< vertex slots
  std::uint32_t beyond;    ///< the triangle outside the cavity; kNoSlot on the sheet's boundary
  TriangleEdge inside;     ///< the triangle in the cavity, and the index of the edge in it
};

enum class InsertionOutcome {
  kDone,
  /// A part of the cavity's boundary is not visible from the point, so that triangles of the star
  /// would overlap or have no area.
  kNotVisible,
  kCapacity,  ///< the mesh has too few free slots
};

/// find() finds a cavity, and insert() fills the cavity found last. Both take time proportional to
/// the cavity. Only the constructor allocates.
class PointInsertion {
 public:
  /// Largest number of triangles in a cavity. find() returns false for a larger cavity.
  static constexpr std::size_t kMaxCavity = 1024;

  PointInsertion(std::size_t vertex_slots, std::size_t triangle_slots);

  /// Finds the cavity of the point `p`, starting at the triangle `start`. Returns false if the
  /// circumcircle of `start` does not contain p, or if the cavity is too large.
  bool find(const SheetMesh& mesh, std::uint32_t start, LatticePoint p) noexcept;
  std::span<const CavityEdge> boundary() const noexcept { return boundary_; }
  std::span<const std::uint32_t> cavity() const noexcept { return cavity_; }

  /// Replaces the cavity by the star of p. `split` is kNoSlot, or the index in boundary() of an
  /// edge of the sheet's boundary that p splits. In the second case p must lie on that edge or on
  /// the edge's inner side. Two edges that meet at p then replace the split edge, and the area
  /// between the split edge and the two new edges no longer belongs to the sheet. If the result is
  /// not kDone, nothing is changed.
  InsertionOutcome insert(SheetMesh& mesh, SheetEdit& edit, LatticePoint p,
                          std::uint32_t split) noexcept;
  /// The star's triangles after insert(), each with p as its last corner.
  std::span<const std::uint32_t> star() const noexcept { return star_; }
  /// The slot of the vertex that insert() has added.
  std::uint32_t vertex() const noexcept { return vertex_; }

 private:
  std::vector<std::uint32_t> cavity_, star_;
  std::vector<CavityEdge> boundary_;
  std::uint32_t vertex_ = kNoSlot;
  // visited_[t]: number of the last call of find() whose cavity contains the triangle of slot t.
  std::vector<std::uint32_t> visited_;
  // starting_[v]: the triangle of the star whose edge 0 starts at the vertex of slot v.
  std::vector<std::uint32_t> starting_;
  std::uint32_t search_ = 0;  // number of the last call of find()
};

}  // namespace trocar::runtime
