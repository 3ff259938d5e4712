// SPDX-License-Identifier: Apache-2.0
// A new point in a SheetMesh that is constrained Delaunay, which it stays: the triangles whose
// circumcircles hold the point make way for its star (Bowyer; Watson, 1981). Exact integers.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "runtime/mesh/sheet_edit.h"
#include "runtime/mesh/sheet_mesh.h"

namespace trocar::runtime {

/// A side of the cavity's border, the cavity on its left.
struct RimSide {
  std::uint32_t from, to;      ///< vertices
  std::uint32_t beyond;        ///< the triangle outside the cavity; kNone on the sheet's boundary
  std::uint32_t inside, side;  ///< the triangle in the cavity and which side of it this is
};

enum class Insertion {
  kDone,
  kNotInSight,  ///< part of the border cannot be seen from the point
  kNoRoom,      ///< no free slots
};

/// find() looks, insert() acts on what was found last. Only the constructor allocates. Both cost
/// what the cavity is large.
class PointInsertion {
 public:
  /// Larger cavities are refused.
  static constexpr std::size_t kMaxCavity = 1024;

  PointInsertion(std::size_t vertex_slots, std::size_t triangle_slots);

  /// The cavity of `p`, searched from triangle `start`. False if the circumcircle of `start` does
  /// not hold p, or the cavity is too large. The mesh is only read.
  bool find(const SheetMesh& mesh, std::uint32_t start, LatticePoint p) noexcept;
  std::span<const RimSide> rim() const noexcept { return rim_; }
  std::span<const std::uint32_t> cavity() const noexcept { return cavity_; }

  /// Puts the star of p in the cavity's place. `split` is kNone, or the number in rim() of a side
  /// on the sheet's boundary that p splits: it gives way to two sides to p, wherever on it or on
  /// its inner side p lies; what lies between the three is no longer part of the sheet. Changes
  /// nothing unless it is done.
  Insertion insert(SheetMesh& mesh, SheetEdit& edit, LatticePoint p, std::uint32_t split) noexcept;
  /// After insert(): the star's triangles, each with p as its last corner.
  std::span<const std::uint32_t> star() const noexcept { return star_; }
  std::uint32_t vertex() const noexcept { return vertex_; }

 private:
  std::vector<std::uint32_t> cavity_, star_;
  std::vector<RimSide> rim_;
  std::uint32_t vertex_ = kNone;
  std::vector<std::uint32_t> visited_;   // by triangle slot: == search_ if it is in the cavity
  std::vector<std::uint32_t> starting_;  // by vertex slot: the star's triangle that starts there
  std::uint32_t search_ = 0;
};

}  // namespace trocar::runtime
